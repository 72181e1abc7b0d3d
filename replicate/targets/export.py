"""Poses and clips for other programs."""

import argparse

from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.cli.options import characters
from replicate.export.command import Request, export
from replicate.methods import artefacts


def run(options: argparse.Namespace) -> None:
    """Write a pose or a clip of every character."""
    request = Request(options.pose, options.clip, options.params, options.to, options.tolerance)
    names = characters(options)
    if request.to is not None and len(names) > 1:
        raise InputError(f"{len(names)} characters can't all be written to {request.to}: name one, or leave out to")
    for character in names:
        files, about = export(artefacts.rig_of(character), request)
        print(f"written to {', '.join(paths.display_path(file.absolute()) for file in files)}: {about}")
