"""The exception that reporting raises."""


class ReportError(Exception):
    """The input of a report is wrong; the message names the place, the value, what is allowed and the remedy."""
