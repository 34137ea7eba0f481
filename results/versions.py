"""Which results the scripts beside this read."""

RESULT = 1  # the newest version of schema.json


def unread(result):
    """Why a result is of a version that is not read, or nothing. One without schema_version is of version 1."""
    version = result.get("schema_version", 1)
    if isinstance(version, int) and not isinstance(version, bool) and 1 <= version <= RESULT:
        return ""
    accepted = RESULT if RESULT == 1 else f"1 to {RESULT}"
    return f"schema_version: {version!r}; expected {accepted}: a newer Voxspring wrote it"
