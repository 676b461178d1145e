"""Tables of refusals, one broken case a row: ``old=>new && old=>new ;; key ;; words``, \\n for the end of a line."""

Changes = tuple[tuple[str, ...], ...]


def refusal_rows(table: str) -> list[tuple[Changes, str, str]]:
    """Changes to a good case, the key that is told, and words of what is said of it."""
    rows = [row.replace("\\n", "\n").split(" ;; ") for row in table.strip().splitlines()]
    return [(tuple(tuple(c.split("=>")) for c in changes.split(" && ")), key, words) for changes, key, words in rows]
