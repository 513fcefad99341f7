"""What reporting raises when its input cannot become a report."""


class ReportError(Exception):
    """The input of a report is wrong; the message says what, where, value, what is allowed, remedy."""
