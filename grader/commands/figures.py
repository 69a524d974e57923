"""`grade figures`: list the pictures that a report can show."""

from functools import partial

from grader.commands.listing import run_listing

run = partial(run_listing, "figures")
