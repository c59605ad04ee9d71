"""`python -m hil`: the same as `uuv-hil`."""

import sys

from hil.cli import main

sys.exit(main(sys.argv[1:]))
