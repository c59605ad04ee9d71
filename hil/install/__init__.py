"""Install slaves: as a service on a board, with its removal, and as processes of a fleet on other machines, by ssh.

Public: every module here. It must not know what a slave does.
"""
