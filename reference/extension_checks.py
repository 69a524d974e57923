"""The checks of Lab 09-01's extensions that no built-in one says."""

from __future__ import annotations

from dataclasses import dataclass

from grader.own_checks import Context, Finding, failed, graded

#: The first half of a participant's prefix in a gid: host and process.
PROCESS_DIGITS = 16


@dataclass
class Parameters:
    """Nodes that are to run in one process."""

    nodes: list[str]


def one_process(context: Context, p: Parameters) -> Finding:
    """All nodes run, and in one process: each has an endpoint of its own, whose gid begins with the process."""
    expected = f"{', '.join(p.nodes)} in one process"
    # Every node publishes on one of these.
    own = [each for topic in ("/rosout", "/parameter_events") for each in context.endpoints(topic)]
    processes = {node: {each.gid[:PROCESS_DIGITS] for each in own if each.node == node} for node in p.nodes}
    up = [node for node, found in processes.items() if found]
    if not up:
        return failed(expected, "none of the nodes", "None of the nodes came up under its name.")
    together = max(
        (sum(process in processes[node] for node in up) for node in up for process in processes[node]), default=0
    )
    measured = f"{len(up)} of {len(p.nodes)} nodes, at most {together} in one process"
    missing = [node for node in p.nodes if node not in up]
    reason = f"{', '.join(missing)} did not come up. " if missing else ""
    if together < len(up):
        reason += "They run in several processes."
    # One alone in its process is no composition.
    return graded((together - 1) / (len(p.nodes) - 1), expected, measured, reason.strip())
