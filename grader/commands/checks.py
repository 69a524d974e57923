"""`grade checks`: list the checks for rubrics."""

from functools import partial

from grader.commands.listing import parser_of_listing, run_listing

make_parser = partial(parser_of_listing, "checks")
run = partial(run_listing, "checks")
