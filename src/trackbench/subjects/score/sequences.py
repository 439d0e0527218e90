"""The sequences of a score: pairs of a file of tracks and a file of boxes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from trackbench.base.errors import InputError, counted, nearest_choices
from trackbench.truth.config.logs import is_log, log_names
from trackbench.truth.tracks import TRAFFIC_FORMATS


class Sequences(NamedTuple):
    """Files of boxes, and each tracker's files of tracks, one for each file of boxes."""

    name: str
    truth: list[Path]
    trackers: list[Path]
    """File or folder after which each tracker is named."""
    tracks: list[list[Path]]
    """Files of each tracker, in the order of ``truth``."""


def pair_sequences(
    tracks: Sequence[Path], truth: Sequence[Path], form: str | None = None, truth_form: str | None = None
) -> Sequences:
    """Pair files of tracks with files of boxes.

    With one file of boxes each file of tracks is a tracker. With several, a folder of tracks is a tracker; without
    folders, all files of tracks together are one tracker. Files are paired by their names without the ending.

    Args:
        tracks: files or folders.
        truth: files or folders; every file is a sequence.
        form: format of the tracks, which selects files of a folder by its endings; None for any format.
        truth_form: format of the boxes, which selects files of a folder by its endings; None for any format.

    Raises:
        InputError: a file or folder does not exist, or a file has no partner.
    """
    for path in (*tracks, *truth):
        if not path.exists():
            existing = [file.name for file in path.parent.iterdir()] if path.parent.is_dir() else []
            raise InputError(f"there is no such file; {nearest_choices(path.name, existing)}", file=path)
    folders = [path for path in tracks if _is_folder(path)]
    if len(truth) == 1 and not _is_folder(truth[0]) and not folders:
        return Sequences(truth[0].stem, [*truth], [*tracks], [[file] for file in tracks])
    boxes = _by_name(truth, truth_form)
    if folders and len(folders) < len(tracks):
        raise InputError("a folder of tracks is a tracker: name folders alone, or files alone", file=folders[0])
    if not folders and len(tracks) != len(boxes):
        counts = f"{counted(len(tracks), 'file')} of tracks and {len(boxes)} of boxes"
        raise InputError(f"{counts}: one for each; of several trackers name a folder for each", key="--truth")
    by_tracker = {path: _by_name([path], form) for path in folders} or {tracks[0].parent: _by_name(tracks, form)}
    truth_folder = truth[0] if _is_folder(truth[0]) else truth[0].parent
    for folder, files in by_tracker.items():
        _require_pairs(files, boxes, folder, truth_folder)
    trackers = [folder.absolute().parent if folder.name == "data" else folder.absolute() for folder in by_tracker]
    tracked = [[files[name] for name in boxes] for files in by_tracker.values()]
    return Sequences(truth_folder.absolute().name, [*boxes.values()], trackers, tracked)


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not is_log(path)


def _by_name(paths: Sequence[Path], form: str | None) -> dict[str, Path]:
    """Return the files, and the files of the folders, by the name of their sequence."""
    files: dict[str, Path] = {}
    single = [path for path in paths if not _is_folder(path)]
    stems = [path.stem for path in single]
    names = dict(zip(single, stems if len({*stems}) == len(stems) else log_names([*map(str, single)]), strict=True))
    for path in paths:
        for name, file in _in_folder(path, form) if _is_folder(path) else [(names[path], path)]:
            if name in files:
                raise InputError(f"{name} is a sequence already, in {files[name]}", file=file)
            files[name] = file
    return files


def _in_folder(folder: Path, form: str | None) -> list[tuple[str, Path]]:
    """Return the name and path of each file in a folder or its ``data``, or of ``*/gt/gt.txt`` as in MOTChallenge.

    A stated format selects the files with its endings; without any such file, all files have the format.
    """
    files_folder = folder / "data" if (folder / "data").is_dir() else folder
    formats = TRAFFIC_FORMATS.loaded()
    possible = [formats[form]] if form in formats else formats.values()
    endings = tuple(sorted({ending for form_class in possible for ending in form_class.endings}))
    logs = [file for file in sorted(files_folder.glob("[!.]*")) if is_log(file)]
    files = [file for file in logs if file.name.lower().endswith(endings)] or (logs if form in formats else [])
    by_name = [(file.stem, file) for file in files] or [
        (file.parents[1].name, file) for file in sorted(folder.glob("*/gt/gt.txt"))
    ]
    if not by_name:
        raise InputError(
            f"a folder that is no bag of ROS 2, and no file in it ends in {', '.join(endings)}", file=folder
        )
    return by_name


def _require_pairs(tracks: Mapping[str, Path], boxes: Mapping[str, Path], where: Path, truth: Path) -> None:
    for what, files, others, file in (("tracks", tracks, boxes, where), ("boxes", boxes, tracks, truth)):
        missing = [name for name in others if name not in files]
        if missing:
            more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
            near = nearest_choices(missing[0], [name for name in files if name not in others] or files)
            raise InputError(f"no {what} of the sequence {missing[0]}{more}; {near}", file=file)
