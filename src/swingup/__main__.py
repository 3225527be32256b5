"""``python -m swingup``."""

import sys

from .cli import main

sys.exit(main())
