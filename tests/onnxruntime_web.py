"""ONNX Runtime for the web, where somebody has installed it: npm's package, which tests run in Node.js."""

import os
import shutil
from pathlib import Path

import pytest

from replicate.base.paths import ROOT


def onnxruntime_web():
    """Return the package's folder: ONNXRUNTIME_WEB, or what lies in node_modules; a test without it is skipped."""
    if shutil.which("node") is None:
        pytest.skip("needs Node.js")
    package = Path(os.environ.get("ONNXRUNTIME_WEB") or ROOT / "node_modules" / "onnxruntime-web").absolute()
    if not (package / "package.json").is_file():
        pytest.skip("needs `npm install --no-save onnxruntime-web`, or the package's folder in ONNXRUNTIME_WEB")
    return package
