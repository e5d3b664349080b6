"""The results of a long study, part by part on disk: a run that was stopped goes on where it was."""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

from .. import _cache
from ..io.writing import write_json

logger = logging.getLogger(__name__)

_FORMAT = 3


class Notebook:
    """Parts of a study, each a JSON file that also says under which settings it was made, and in how many seconds.

    Parameters
    ----------
    folder : Path
        Where the parts lie; made if absent.
    tell : callable, optional
        Called with the name of each part that has to be computed.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from sonospline.study.notebook import Notebook
    >>> notebook = Notebook(Path(tempfile.mkdtemp()))
    >>> notebook.part("sum", {"of": [1, 2]}, lambda: 1 + 2)
    3
    >>> notebook.part("sum", {"of": [1, 2]}, lambda: 1 / 0)   # is read, not computed
    3
    """

    def __init__(self, folder: Path, tell: Callable[[str], None] | None = None) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._tell = tell

    def part(self, name: str, settings: dict[str, Any], compute: Callable[[], Any]) -> Any:
        """Return what ``compute`` returned under these settings, now or in an earlier run of this version.

        Parameters
        ----------
        name : str
            Of the part, and of its file.
        settings : dict
            All that the result depends on; anything JSON holds.
        compute : callable
            Makes the result, which JSON must be able to hold.
        """
        file = self._folder / f"{name}.json"
        stamp = {"format": _FORMAT, "version": version("sonospline"), "settings": json.loads(json.dumps(settings))}
        known = _read(file)
        if known is not None and {key: known[key] for key in stamp} == stamp:
            return known["result"]
        if self._tell:
            self._tell(name.replace("_", " "))
        began = time.perf_counter()
        result = json.loads(json.dumps(compute()))
        page = {**stamp, "seconds": time.perf_counter() - began, "result": result}
        try:
            write_json(file, {**page, "seal": _seal(page)})
        except OSError as error:
            logger.warning("cannot keep the part %r: %s", name, error)
        return result


def _read(file: Path) -> dict[str, Any] | None:
    """Return a page; None where there is none, or where what it says is not what was written."""
    try:
        if not file.is_file():
            return None
        page = json.loads(file.read_bytes())
        if page.pop("seal") != _seal(page):
            raise ValueError("it is damaged, or not of this version")
        return {key: page[key] for key in ("format", "version", "settings", "result")}
    except Exception as error:  # whatever is wrong with a part, it must not end the study
        logger.warning("the part kept in %s cannot be used and will be made anew: %r", file, error)
        return None


def _seal(page: dict[str, Any]) -> str:
    return _cache.digest(json.dumps(page, sort_keys=True))
