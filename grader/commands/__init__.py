"""Commands of `grade`, a module each: `run(arguments, console)` parses, calls, prints, returns the exit status."""

#: Description of each command, by the name of its module. Without one of these words, `grade` grades submissions.
COMMANDS = {
    "regrade": "judge recordings again, without ROS",
    "review": "decide the open questions of a class in the browser",
    "appeal": "judge one check again, show its evidence, note question and answer",
    "report": "write the class page and grades.csv from existing results",
    "similarity": "find code in common in the submissions of a class",
    "play": "publish a recording on the ROS graph of this terminal",
    "export": "write results for CI systems, learning platforms and mail programs",
    "selftest": "grade submissions with known verdicts, and compare",
    "doctor": "examine this machine: can it grade, confine, and measure?",
    "checks": "list the checks for rubrics",
    "steps": "list the steps for sessions",
    "figures": "list the figures for reports",
    "lab": "make a lab of your own, check it, and try it",
    "rubric": "check a rubric, or print the JSON Schema for editors",
}
