"""What is sent: a file, bytes, or a zip that is made while it is read.

A :class:`StoredZip` has a length before anything is read and the same bytes at every offset each time, so an upload
can continue at any offset, also in another process. Its members are stored, not compressed: pictures are compressed
already. Nothing is copied to the disk.
"""

from __future__ import annotations

import hashlib
import re
import struct
import zlib
from bisect import bisect_right
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Union

from ._errors import PinstackError
from ._paths import on_disk, walk

PathLike = Union[str, "PurePath"]
#: What can be sent as a zip: a zip file, a folder, a list of slices, or ``{"front": [...], "back": [...]}``, where
#: other names are further lights: ``{"front": [...], "uv": [...]}``.
Sendable = Union[PathLike, bytes, Sequence[PathLike], Mapping[str, Sequence[PathLike]], "Source"]

#: Extensions of pictures that the service reads.
PICTURES = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff"})
#: Folders that systems, file servers and file managers put beside pictures, in lower case. Folders whose name begins
#: with a dot are skipped too. The service and the page *Send* have the same list.
SKIPPED_FOLDERS = frozenset(
    {
        "__macosx",
        "@eadir",
        "#recycle",
        "#snapshot",
        "@recycle",
        "@recently-snapshot",
        "@__thumb",
        "@transcode",
        "@tmp",
        "$recycle.bin",
        "recycler",
        "system volume information",
        "lost+found",
        "network trash folder",
        "temporary items",
    }
)
#: The name of a further light.
LIGHT_NAME = re.compile("[A-Za-z0-9_-]{1,32}")
BLOCK = 1 << 18
#: Bit 3: size and CRC follow the data. Bit 11: names are UTF-8.
FLAGS = 0x0808
#: 1 January 1980, the first date of the format: the bytes do not depend on clocks and time zones.
DATE = 0x0021
#: What a field of 32 bits holds if the value is in a field of zip64.
LIMIT = 0xFFFFFFFF
#: Sizes and offsets from which fields of zip64 are used.
ZIP64_FROM = LIMIT


class Source:
    """Bytes of known length that can be read from any offset, as often as needed."""

    #: Length, bytes.
    length: int
    #: File name to tell the service.
    name: str = "upload.zip"

    def read(self, offset: int, size: int) -> bytes:
        """The ``size`` bytes at ``offset``; fewer only at the end."""
        raise NotImplementedError

    def blocks(self, offset: int = 0) -> Iterator[bytes]:
        """All bytes from ``offset`` on."""
        while offset < self.length:
            block = self.read(offset, BLOCK)
            offset += len(block)
            yield block


class BytesSource(Source):
    """Bytes in memory."""

    def __init__(self, data: bytes, name: str = "upload.zip") -> None:
        self.data = data
        self.length = len(data)
        self.name = name

    def read(self, offset: int, size: int) -> bytes:
        return self.data[offset : offset + size]


class FileSource(Source):
    """A file as it is."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.length = on_disk(path).stat().st_size
        self.name = path.name

    def read(self, offset: int, size: int) -> bytes:
        wanted = min(size, self.length - offset)
        with on_disk(self.path).open("rb") as file:
            file.seek(offset)
            data = file.read(wanted)
        if len(data) != wanted:
            raise _changed(self.path, self.length, offset + len(data))
        return data


@dataclass(frozen=True)
class Member:
    """A file and its name in the zip."""

    path: Path
    name: str
    size: int
    modified_ns: int

    @classmethod
    def of(cls, path: Path, name: str) -> Member:
        """The member for a file as it is now."""
        status = on_disk(path).stat()
        return cls(path, name, status.st_size, status.st_mtime_ns)


@dataclass
class _Progress:
    """How far the CRC of a member is known."""

    position: int = 0
    crc: int = 0


class StoredZip(Source):
    """A zip of files, made while it is read. zip64 is used where a size needs it.

    >>> from pathlib import Path
    >>> source = StoredZip.of_folder(Path("view_01"))       # doctest: +SKIP
    >>> source.length                                       # doctest: +SKIP
    1203412
    """

    def __init__(self, members: Iterable[Member], name: str = "upload.zip") -> None:
        self.members: List[Member] = sorted(members, key=lambda member: (member.name.casefold(), member.name))
        self.name = name
        seen: Dict[str, Path] = {}
        for member in self.members:
            other = seen.setdefault(member.name.casefold(), member.path)
            if other is not member.path:
                raise PinstackError("invalid_source", f"{other} and {member.path} have the same name in the zip")
        self._crcs = [_Progress() for _ in self.members]
        self._starts: List[int] = []
        position = 0
        for member in self.members:
            self._starts.append(position)
            position += len(_local_header(member)) + member.size + len(_descriptor(member, 0))
        self._directory_start = position
        # a CRC changes no length
        self.length = position + len(self._directory([0] * len(self.members)))

    @classmethod
    def of_folder(cls, folder: Path) -> StoredZip:
        """The pictures below a folder, and a ``manifest.json``, with their folders. Other files are left out."""
        members = [
            Member.of(path, member_name(path.relative_to(folder)))
            for path in sorted(here / name for here, _, names in walk(folder) for name in names)
            if is_sent(path.relative_to(folder)) and on_disk(path).is_file()
        ]
        if not any(is_picture(member.path) for member in members):
            detail = f"{folder} holds no JPEG, PNG or TIFF pictures; for camera raw files use pinstack push or convert"
            raise PinstackError("invalid_source", detail)
        return cls(members, name=f"{folder.resolve().name or 'upload'}.zip")

    @classmethod
    def of_slices(
        cls, front: Sequence[PathLike], back: Sequence[PathLike] = (), is_ordered: bool = False,
        lights: Optional[Mapping[str, Sequence[PathLike]]] = None,
    ) -> StoredZip:  # fmt: skip
        """A stack of these slices, fused in the order of their names; with ``is_ordered`` in that of the lists, and
        their names in the zip begin with a number. ``lights`` are further lights by name."""
        folders = {"front": front, "back": back, **(lights or {})}
        members = [
            Member.of(Path(path), f"{light}/{f'{at:05d}_' if is_ordered else ''}{Path(path).name}")
            for light, paths in folders.items()
            for at, path in enumerate(paths, 1)
        ]
        if not members:
            raise PinstackError("invalid_source", "the list of slices is empty")
        return cls(members, name="stack.zip")

    def shape(self) -> str:
        """A text that changes when a name or size of a file changes."""
        return _digest((member.name, member.size) for member in self.members)

    def times(self) -> str:
        """A text that changes when the time of a file changes."""
        return _digest(member.modified_ns for member in self.members)

    def content(self) -> str:
        """A text that changes when a name or the content of a file changes. Reads what was not read yet."""
        return _digest((member.name, member.size, self._crc(at)) for at, member in enumerate(self.members))

    def member_bytes(self, index: int) -> bytes:
        """The content of a member. Raises ``source_changed`` if its file has another size now."""
        return self._read_data(index, 0, self.members[index].size)

    def read(self, offset: int, size: int) -> bytes:
        pieces: List[bytes] = []
        end = min(offset + size, self.length)
        while offset < end:
            if offset >= self._directory_start:
                directory = self._directory([self._crc(index) for index in range(len(self.members))])
                piece = directory[offset - self._directory_start : end - self._directory_start]
            else:
                index = bisect_right(self._starts, offset) - 1
                piece = self._read_member(index, offset - self._starts[index], end - offset)
            pieces.append(piece)
            offset += len(piece)
        return b"".join(pieces)

    def _read_member(self, index: int, at: int, size: int) -> bytes:
        member = self.members[index]
        header = _local_header(member)
        if at < len(header):
            return header[at : at + size]
        at -= len(header)
        if at < member.size:
            return self._read_data(index, at, min(size, member.size - at))
        at -= member.size
        return _descriptor(member, self._crc(index))[at : at + size]

    def _read_data(self, index: int, at: int, size: int) -> bytes:
        member = self.members[index]
        with on_disk(member.path).open("rb") as file:
            file.seek(at)
            data = file.read(size)
            # a longer file shows at its end
            is_longer = at + size == member.size and file.read(1) != b""
        if len(data) != size or is_longer:
            raise _changed(member.path, member.size, on_disk(member.path).stat().st_size)
        progress = self._crcs[index]
        known = progress.position - at
        if 0 <= known < size:
            progress.crc = zlib.crc32(data[known:], progress.crc)
            progress.position = at + size
        return data

    def _crc(self, index: int) -> int:
        """The CRC of a member; what was not read yet is read now."""
        progress, size = self._crcs[index], self.members[index].size
        while progress.position < size:
            self._read_data(index, progress.position, min(BLOCK, size - progress.position))
        return progress.crc

    def _directory(self, crcs: List[int]) -> bytes:
        entries = b"".join(
            _directory_entry(member, crc, start) for member, crc, start in zip(self.members, crcs, self._starts)
        )
        return entries + _directory_end(len(self.members), len(entries), self._directory_start)


def member_name(relative: PurePath) -> str:
    """The name in a zip of a path relative to its folder: with ``/``, on every system."""
    return "/".join(relative.parts)


def is_picture(path: PurePath) -> bool:
    """Whether the service reads a file of this name as a slice."""
    return path.suffix.lower() in PICTURES


def is_skipped_folder(name: str) -> bool:
    """Whether nothing below a folder of this name is sent."""
    return name.startswith(".") or name.lower() in SKIPPED_FOLDERS


def is_sent(relative: PurePath) -> bool:
    """Whether a file below a folder is sent with it: a picture or a manifest, not hidden, not made by a system."""
    if relative.name.startswith(".") or any(is_skipped_folder(part) for part in relative.parts[:-1]):
        return False
    return is_picture(relative) or relative.name.lower() == "manifest.json"


def source(sendable: Sendable) -> Source:
    """What to read for something that a user wants to send."""
    if isinstance(sendable, Source):
        return sendable
    if isinstance(sendable, bytes):
        return BytesSource(sendable)
    if isinstance(sendable, (str, PurePath)):
        path = Path(sendable)
        if on_disk(path).is_dir():
            return StoredZip.of_folder(path)
        if is_picture(path):
            raise PinstackError(
                "invalid_source", f"{path} is one picture; send the list of all slices, or their folder"
            )
        return FileSource(path)
    if isinstance(sendable, Mapping):
        lights = {name: paths for name, paths in sendable.items() if name not in ("front", "back")}
        wrong = sorted(name for name in lights if not LIGHT_NAME.fullmatch(name))
        if wrong:
            detail = f"slices are 'front', 'back' or a further light of letters, digits, '-' and '_', not {wrong[0]!r}"
            raise PinstackError("invalid_source", detail)
        empty = sorted(name for name, paths in lights.items() if not paths)
        if empty:
            raise PinstackError("invalid_source", f"the list of slices of the further light {empty[0]!r} is empty")
        return StoredZip.of_slices(sendable.get("front", ()), sendable.get("back", ()), lights=lights)
    return StoredZip.of_slices(sendable)


def with_moved(target: Sendable, moved: Union[PathLike, Sequence[PathLike]]) -> StoredZip:
    """A dot target with pictures of the same target after it was moved, in the folder ``moved`` of the zip."""
    zipped = source(target)
    if not isinstance(zipped, StoredZip):
        detail = "give the target as a folder or a list, or put the folder 'moved' into the zip and omit moved"
        raise PinstackError("invalid_source", detail)
    if not isinstance(moved, (str, PurePath)):
        inner = [Member.of(Path(path), Path(path).name) for path in moved]
    elif on_disk(Path(moved)).is_dir():
        inner = StoredZip.of_folder(Path(moved)).members
    else:
        inner = [Member.of(Path(moved), Path(moved).name)]
    pictures = [replace(member, name=f"moved/{member.name}") for member in inner if is_picture(member.path)]
    return StoredZip([*zipped.members, *pictures], name=zipped.name)


def utf8(text: str) -> bytes:
    """A text as UTF-8. What is not valid text in a file name (lone surrogates) becomes ``_``."""
    return re.sub(r"[\ud800-\udfff]", "_", text).encode("utf-8")


def _digest(values: Iterable[object]) -> str:
    digest = hashlib.sha256()
    for value in values:
        digest.update(f"{value!r}\n".encode("utf-8", "surrogatepass"))
    return digest.hexdigest()


def _changed(path: Path, size: int, now: int) -> PinstackError:
    detail = f"{path} changed while it was sent: it had {size} bytes, now it has {now}; wait until it is complete"
    return PinstackError("source_changed", detail)


def _local_header(member: Member) -> bytes:
    name = utf8(member.name)
    is_large = member.size >= ZIP64_FROM
    # with an extra field of zip64 the sizes that follow the data have 8 bytes
    extra = struct.pack("<HHQQ", 1, 16, 0, 0) if is_large else b""
    size = LIMIT if is_large else 0
    version = 45 if is_large else 20
    fixed = struct.pack("<4s5H3I2H", b"PK\3\4", version, FLAGS, 0, 0, DATE, 0, size, size, len(name), len(extra))
    return fixed + name + extra


def _descriptor(member: Member, crc: int) -> bytes:
    layout = "<4sIQQ" if member.size >= ZIP64_FROM else "<4sIII"
    return struct.pack(layout, b"PK\7\x08", crc, member.size, member.size)


def _directory_entry(member: Member, crc: int, start: int) -> bytes:
    name = utf8(member.name)
    large: List[int] = [member.size, member.size] if member.size >= ZIP64_FROM else []
    size = LIMIT if large else member.size
    start_field = start
    if start >= ZIP64_FROM:
        large.append(start)
        start_field = LIMIT
    extra = struct.pack(f"<HH{len(large)}Q", 1, 8 * len(large), *large) if large else b""
    version = 45 if large else 20
    fixed = struct.pack(
        "<4s6H3I2H", b"PK\1\2", version, version, FLAGS, 0, 0, DATE, crc, size, size, len(name), len(extra)
    )
    return fixed + struct.pack("<3H2I", 0, 0, 0, 0, start_field) + name + extra


def _directory_end(count: int, size: int, start: int) -> bytes:
    end = struct.pack("<4s4H2IH", b"PK\5\6", 0, 0, min(count, 0xFFFF), min(count, 0xFFFF), min(size, LIMIT),
                      min(start, LIMIT), 0)  # fmt: skip
    if count < 0xFFFF and size < ZIP64_FROM and start < ZIP64_FROM:
        return end
    large = struct.pack("<4sQ2H2I4Q", b"PK\6\6", 44, 45, 45, 0, 0, count, count, size, start)
    return large + struct.pack("<4sIQI", b"PK\6\7", 0, start + size, 1) + end
