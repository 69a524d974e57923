"""Commands of `grade`, a module each: `run(arguments, console)` parses, calls, prints, returns the exit status."""

#: Description of each command, by its group and the name of its module.
GROUPS = {
    "results": {
        "open": "open a report or the page of a class in the browser",
        "review": "decide the open questions of a class in the browser",
        "appeal": "judge one check again, show its evidence, note question and answer",
        "regrade": "judge recordings again, without ROS",
        "report": "write the class page and grades.csv from existing results",
        "export": "write results for CI systems, learning platforms and mail programs",
        "similarity": "find code in common in the submissions of a class",
        "play": "publish a recording on the ROS graph of this terminal",
    },
    "labs": {
        "lab": "list and copy labs; make a lab of your own, check it, and try it",
        "rubric": "check a rubric, or print the JSON Schema for editors",
        "checks": "list the checks for rubrics",
        "steps": "list the steps for sessions",
        "figures": "list the figures for reports",
        "selftest": "grade submissions with known verdicts, and compare",
    },
    "this machine": {
        "try": "write a sample submission into this folder, and grade it",
        "doctor": "examine this machine: can it grade, confine, and measure?",
        "completion": "print the completion of commands and options for a shell",
    },
}
#: Description of each command. Without one of these words, `grade` grades submissions.
COMMANDS: dict[str, str] = {}
for _group in GROUPS.values():
    COMMANDS.update(_group)
