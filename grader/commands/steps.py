"""`grade steps`: list the steps for sessions."""

from functools import partial

from grader.commands.listing import parser_of_listing, run_listing

make_parser = partial(parser_of_listing, "steps")
run = partial(run_listing, "steps")
