"""The zenoh endpoint, and the partners at the other ends of all endpoints (`hil.links.endpoints`).

Public: `opening.open_link`, `peer.Peer`. It must not know what messages mean: packets come in and go out.
"""
