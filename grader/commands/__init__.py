"""The commands of `grade`, a module each: `run(arguments, console)` parses, calls, prints, returns the exit status."""

#: Command -> what it does; each is a module of `grader.commands`. Without one of these words, submissions are graded.
COMMANDS = {
    "regrade": "judge recordings again, without ROS",
    "review": "decide, in the browser, what of a class needs a person",
    "appeal": "the evidence about one check, judged again, with question and answer",
    "report": "the page over a class and its grades.csv, from results that are there",
    "similarity": "what the submissions of a class have in common beside what the lab gave out",
    "play": "publish a recording again, on the ROS graph of this terminal",
    "export": "write results in the forms of CI systems and learning platforms",
    "selftest": "grade submissions whose verdict is known, and compare",
    "doctor": "examine this machine: can it grade, how well does it confine, how quiet is it",
    "checks": "list the checks that a rubric can use",
    "steps": "list the steps that a session can have",
    "figures": "list the pictures that a report can show",
    "lab": "make a lab of one's own, examine it, grade its solution and fixtures",
    "rubric": "check a rubric, or print its JSON Schema for an editor",
}
