"""Slaves on the machines they are for: a board's service and what removes it again, and a fleet's, over ssh.

Public: `hil.install.units`, `hil.install.fleet`. It must not know what a slave does.
"""
