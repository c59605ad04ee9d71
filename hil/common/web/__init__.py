"""Servers for web pages and websockets: who may use them, and the limits that all of them share.

Public: the classes of the modules. They must not know what is served.
"""
