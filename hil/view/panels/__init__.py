"""The panels beside the scene: instruments, pictures, links, actions, time.

Public: `panels.Panels` and the panels of actions, time and recording. It must not read the network: samples come from a
`Source`, commands go through `hil.client`.
"""
