"""The slave as a service of a board: systemd units, udev rules, and what removes them again.

Public: `hil.install.units`. It must not start a slave itself.
"""
