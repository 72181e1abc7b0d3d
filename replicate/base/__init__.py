"""The ground of both packages: errors, checked settings, paths, files, tables, progress."""
