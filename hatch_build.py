"""Compile what is hot with mypyc into the wheel, when `HATCH_BUILD_HOOKS_ENABLE=1` asks for it.

`python hatch_build.py` only translates to C, without a compiler: does mypyc take every line?
"""

from __future__ import annotations

import atexit
import shutil
import tempfile
import tomllib
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from mypyc.build import mypycify
from setuptools import Distribution


def translate(modules: dict[str, list[str]], folder: str) -> list[Any]:
    """Write modules, named by their package, as C to a folder; the extensions to build there."""
    files = [f"{package}/{name}.py" for package, names in modules.items() for name in names]
    extensions = mypycify(
        ["--config-file=", "--ignore-missing-imports", *files],
        opt_level="2",
        debug_level="0",
        target_dir=folder,
    )
    for extension in extensions:
        # else multiplications are fused with additions where a processor can, and round once less
        extension.extra_compile_args = [*extension.extra_compile_args, "-ffp-contract=off"]
    return extensions


class CompiledHook(BuildHookInterface[Any]):
    """Adds machine code to a wheel, beside the sources; an editable install has none."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile into a folder of its own, and have it packed."""
        if version == "editable":
            return
        folder = tempfile.mkdtemp()
        atexit.register(shutil.rmtree, folder)
        extensions = translate(self.config["modules"], folder)
        build = Distribution({"ext_modules": extensions}).get_command_obj("build_ext")
        build.build_temp, build.build_lib = folder, f"{folder}/wheel"
        build.ensure_finalized()
        build.run()
        build_data["force_include"][build.build_lib] = ""
        build_data["infer_tag"], build_data["pure_python"] = True, False


if __name__ == "__main__":
    project = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))
    hook = project["tool"]["hatch"]["build"]["targets"]["wheel"]["hooks"]["custom"]
    with tempfile.TemporaryDirectory() as scratch:
        translate(hook["modules"], scratch)
