"""Runs the checks of this folder in containers: `main.py FOLDER CGROUP [FILE ...]`; scripts/containers.sh calls it."""

import importlib
import os
import pathlib
import sys
import time
import traceback

sys.path.insert(0, str(pathlib.Path(__file__).parents[2] / "clients/python/src"))
folder, group, *chosen = sys.argv[1:]
os.environ["PINSTACK_CONTAINERS_FOLDER"] = folder

import engine

FILES = ["single", "limits", "cluster", "bucket"]


def main():
    """Runs every function whose name begins with `check_`, in order; each begins with nothing that runs."""
    began = time.monotonic()
    try:
        started = engine.Engine(folder, group)
    except AssertionError as error:
        print(f"Docker does not start here: {error}")
        return 3
    started.images()
    print(f"images built ({time.monotonic() - began:.0f} s)", flush=True)
    passed = failed = 0
    for name in chosen or FILES:
        module = importlib.import_module(name)
        for check in [value for key, value in vars(module).items() if key.startswith("check_")]:
            began = time.monotonic()
            try:
                told = check()
            except Exception:  # noqa: BLE001, the next checks run all the same
                traceback.print_exc(file=sys.stdout)
                told, failed = "FAILED", failed + 1
            else:
                passed += 1
            print(f"{name}: {check.__name__[6:]}: {told or 'ok'} ({time.monotonic() - began:.0f} s)", flush=True)
    print(f"{passed} passed, {failed} failed")
    return 1 if failed or not passed else 0


if __name__ == "__main__":
    sys.exit(main())
