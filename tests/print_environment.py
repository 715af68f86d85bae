"""Names of the environment's variables, for a test of what a process is given."""

import os
import sys

sys.stdout.write("\n".join(os.environ))
