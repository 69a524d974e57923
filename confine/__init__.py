"""Confinement of hostile programs on Linux, in four levels; needs the standard library alone.

`python -m confine -- COMMAND` runs a command confined; README.md has the threat model, the API and an example. The
package imports no other package of this repository. `confine` itself imports none of its modules, so that
`confine.limits` starts no process and can be imported on every system.
"""
