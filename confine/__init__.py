"""Confinement of hostile programs on Linux, in four levels; needs the standard library alone.

`python -m confine -- COMMAND` runs a command confined, and README.md says what that stops. The package imports no other
package of this repository, and no module of it imports another one unless asked, so that `confine.limits` starts no
process and can be read on every system.
"""
