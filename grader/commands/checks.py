"""`grade checks`: list the checks for rubrics."""

from functools import partial

from grader.commands.listing import run_listing

run = partial(run_listing, "checks")
