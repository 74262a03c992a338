"""`planewright doctor`: what is installed, what is missing or does not load, and how to get it."""

import importlib
import importlib.metadata

from rich.console import Console

from planewright.pipeline.machine import machine, requirements, versions


def run() -> None:
    """Print what there is and a closing sentence. A missing package is what it is there to show, so it loads none of them for itself."""
    console = Console(markup=False, highlight=False, soft_wrap=True)
    found, system, broken = versions(), machine(), broken_packages()
    for name, version in found.items():
        console.print(f"{name:32}{version or 'missing'}{'  does not load: ' + broken[name] if name in broken else ''}")
    console.print(f"{'system':32}{system['system']} {system['release']}, {system['processor']}, {system['cores']} cores")
    faulty = sorted({name for name in requirements() if found[name] is None} | set(broken))
    if faulty:
        console.print(f"Missing or broken: {', '.join(faulty)}. Get them with: python -m pip install --force-reinstall {' '.join(faulty)}")
    else:
        console.print("Everything that planewright needs is here. This version has no optional parts.")


def broken_packages() -> dict[str, str]:
    """Packages that are installed but cannot be loaded, with the reason: a system library that is not there, say."""
    broken: dict[str, str] = {}
    wanted = {name.lower() for name in requirements()}
    for module, packages in sorted(importlib.metadata.packages_distributions().items()):
        needed = [name for name in packages if name.lower() in wanted]
        if needed and module.isidentifier() and not module.startswith("_"):
            try:
                importlib.import_module(module)
            except (ImportError, OSError, RuntimeError) as error:
                broken[needed[0]] = str(error)
    return broken
