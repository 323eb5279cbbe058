"""`isoshape compile`: the kernels for this processor."""

import time

from core.parameters import Parameters
from service.compute.compilation import compile_kernels, is_compiled
from service.console import fail, progress, say
from service.settings import load_parameters, load_settings


def command() -> None:
    """Compile the kernels for this processor, once.

    numba keeps them beside the sources, or in the folder that NUMBA_CACHE_DIR names. ISOSHAPE_PIPELINE names
    the pipeline. A service compiles what is missing when it starts; this command does it in advance, as when
    Isoshape is installed.
    """
    parameters = load_parameters(load_settings().pipeline)
    if is_compiled(parameters):
        say("the kernels are compiled for this processor")
        return
    try:
        compile_with_bar(parameters)
    except KeyboardInterrupt:
        fail("stopped; the next start goes on", status=130)


def compile_with_bar(parameters: Parameters) -> None:
    """Compile the kernels that are missing, and show the progress."""
    say("compiling for this processor, once; it takes about a minute on an idle machine")
    begun = time.monotonic()
    with progress() as bar:
        task = bar.add_task("compiling", total=None)
        compile_kernels(parameters, lambda done, total: bar.update(task, completed=done, total=total))
    say(f"compiled in {time.monotonic() - begun:.0f} s")
