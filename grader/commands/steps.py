"""`grade steps`: list the steps that a session can have."""

from functools import partial

from grader.commands.listing import run_listing

run = partial(run_listing, "steps")
