"""Formation control and target hunting of several vehicles.

Public: `formation`, `hunting.Hunter`, and `hunting.Referee`, which judges a hunt. It must not know how vehicles
exchange their positions.
"""
