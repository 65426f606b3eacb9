"""A plugin that `make test` loads before nbval's: jsonschema then does without a grammar of web addresses, which
nothing here needs and each process would take over a second to compile."""

import sys

sys.modules["rfc3987_syntax"] = None
