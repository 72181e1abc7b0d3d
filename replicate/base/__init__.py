"""The ground of both packages: errors, checked settings, paths, files, tables, progress."""

import time

LOADED = time.time()  # when this process began to load the project; a source that changes later isn't what it has
