"""`grade figures`: list the figures for reports."""

from functools import partial

from grader.commands.listing import parser_of_listing, run_listing

make_parser = partial(parser_of_listing, "figures")
run = partial(run_listing, "figures")
