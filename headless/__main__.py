"""``python -m headless``."""

from .interrupt import quietly

quietly()  # before the first import that takes a while

import sys  # noqa: E402

from .cli import main  # noqa: E402

sys.exit(main())
