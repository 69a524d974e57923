"""`grade steps`: list the steps for sessions."""

from functools import partial

from grader.commands.listing import run_listing

run = partial(run_listing, "steps")
