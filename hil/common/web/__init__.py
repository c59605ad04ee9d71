"""Servers for web pages and websockets: who may use them, and the limits that all of them share.

Public: every module here. They must not know what is served.
"""
