"""`grade checks`: list the checks that a rubric can use."""

from functools import partial

from grader.commands.listing import run_listing

run = partial(run_listing, "checks")
