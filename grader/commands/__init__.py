"""The commands of `grade`, a module each: `run(arguments, console)` parses, calls, prints, returns the exit status."""
