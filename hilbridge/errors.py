"""The one kind of error that is the user's to mend: its text is one line that names the thing and the cure."""


class InputError(ValueError):
    """Something given from outside cannot be used. The command line prints the text and exits with 2."""
