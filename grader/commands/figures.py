"""`grade figures`: list the figures for reports."""

from functools import partial

from grader.commands.listing import run_listing

run = partial(run_listing, "figures")
