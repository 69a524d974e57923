"""Right values of the relay's messages."""


def times(streams, parameters, seed):
    """Return the expected number for each drive command: `factor` times what came, 3 by default."""
    return parameters.get("factor", 3.0) * streams["command"].values


def now(streams, parameters, seed):
    """Return the expected number at the time of each drive command."""
    command = streams["command"]
    return {"times_ns": command.source_ns, "values": 3.0 * command.values}
