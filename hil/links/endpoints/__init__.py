"""Endpoints with several partners, for servers: UDP, TCP, serial devices and pseudo terminals.

Public: every module here: `sockets.Link` is what all of them are, `patient.open_endpoint` opens one now or as soon as
it can. They must not know what the bytes mean.
"""
