"""Write the configuration that an OCI runtime starts the built image with, as ``compose.yaml`` asks for it.

``bundle.py COMPOSE IMAGE ROOT DATA BUNDLE``: the compose file; the image's configuration, as ``buildah
inspect`` prints it; the mounted root of a container of it; the folder that stands for the volume; the folder
to write ``config.json`` to. The container has a network of its own with nothing but the loopback in it, so a
service that asked for anything from outside would fail. Limits of memory and of processes need control groups
and are not set here.
"""

import json
import os
import re
import sys
from pathlib import Path
from typing import Any

import yaml


def mount(kind: str, destination: str, *options: str) -> dict[str, Any]:
    """A file system of the kernel's at a place in the container."""
    return {"destination": destination, "type": kind, "source": kind, "options": list(options)}


KERNEL = [
    mount("proc", "/proc"),
    mount("tmpfs", "/dev", "nosuid", "mode=755", "size=64m"),
    mount("devpts", "/dev/pts", "nosuid", "noexec", "newinstance", "mode=0620"),
    mount("tmpfs", "/dev/shm", "nosuid", "noexec", "nodev", "mode=1777", "size=64m"),
    mount("mqueue", "/dev/mqueue", "nosuid", "noexec", "nodev"),
]
HIDDEN = [f"/proc/{name}" for name in ("acpi", "kcore", "keys", "latency_stats", "sched_debug", "timer_list")]
FIXED = ["/proc/bus", "/proc/fs", "/proc/irq", "/proc/sys", "/proc/sysrq-trigger"]
CAPABILITY_SETS = ("bounding", "effective", "inheritable", "permitted", "ambient")


# ${NAME:?what to say when it is missing} and ${NAME:-what stands for it}, as Compose reads them.
VARIABLE = re.compile(r"\$\{(\w+):([?-])([^}]*)\}")


def interpolated(value: str) -> str:
    """A value of the compose file with the variables of this environment in it."""

    def replaced(found: re.Match[str]) -> str:
        name, kind, text = found.groups()
        if given := os.environ.get(name):
            return given
        if kind == "?":
            raise SystemExit(f"{name}: {text}")
        return text

    return VARIABLE.sub(replaced, value)


def mounts(service: dict[str, Any], data: Path) -> list[dict[str, Any]]:
    """The service's tmpfs and its one volume, with the options that Docker gives each."""
    extra = []
    for entry in service.get("tmpfs", []):
        path, _, options = entry.partition(":")
        extra.append(mount("tmpfs", path, "nosuid", "nodev", "noexec", *filter(None, options.split(","))))
    (volume,) = service["volumes"]
    destination = volume.partition(":")[2]
    bind = {"destination": destination, "type": "bind", "source": str(data), "options": ["rbind", "rw"]}
    return [*KERNEL, *extra, bind]


def configuration(service: dict[str, Any], image: dict[str, Any], root: Path, data: Path) -> dict[str, Any]:
    """The runtime's ``config.json`` for the image run as the service."""
    user, _, group = (service.get("user") or image["User"]).partition(":")
    kept: list[str] = [] if service.get("cap_drop") == ["ALL"] else ["CAP_CHOWN", "CAP_SETUID", "CAP_SETGID"]
    return {
        "ociVersion": "1.0.0",
        "process": {
            "terminal": False,
            "user": {"uid": int(user), "gid": int(group)},
            "args": [*(image.get("Entrypoint") or []), *image["Cmd"]],
            "env": image["Env"]
            + [
                f"{name}={interpolated(str(value))}" for name, value in service.get("environment", {}).items()
            ],
            "cwd": image["WorkingDir"],
            "capabilities": dict.fromkeys(CAPABILITY_SETS, kept),
            "noNewPrivileges": "no-new-privileges:true" in service.get("security_opt", []),
        },
        "root": {"path": str(root), "readonly": service.get("read_only", False)},
        "hostname": "isoshape",
        "mounts": mounts(service, data),
        "linux": {
            "namespaces": [{"type": kind} for kind in ("pid", "ipc", "uts", "mount", "network")],
            "maskedPaths": HIDDEN,
            "readonlyPaths": FIXED,
        },
    }


def main() -> None:
    """Write what the arguments ask for."""
    compose, inspected, root, data, bundle = map(Path, sys.argv[1:])
    service = yaml.safe_load(compose.read_text())["services"]["isoshape"]
    image = json.loads(inspected.read_text())["Docker"]["config"]
    (bundle / "config.json").write_text(json.dumps(configuration(service, image, root, data), indent=2))


if __name__ == "__main__":
    main()
