"""Install slaves: with services beside them on a board, and their removal; as processes of a fleet elsewhere, by ssh.

Public: every module here. It must not know what a slave does.
"""
