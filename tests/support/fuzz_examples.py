"""How many broken inputs are tried."""

import os

EXAMPLES = int(os.environ.get("FUZZ_EXAMPLES", "2"))
