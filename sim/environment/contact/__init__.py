"""Find the contacts of a hull and solve their impulses: parts of sim/environment/collision.py, their only user.

Public: `SeabedContact`, `MeshContact`, `touches` of `solids`, and `Touch`. It must not move the vehicle."""
