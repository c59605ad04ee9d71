"""UDP, TCP, serial and zenoh endpoints, and the partners at their other ends.

Public: `opening.open_link`, `peer.Peer`. It must not know what messages mean: packets come in and go out.
"""
