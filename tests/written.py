"""Small tables as files."""


def written(path, text):
    """A file of that text, without its blanks."""
    path.write_text(text.replace(" ", ""))
    return path
