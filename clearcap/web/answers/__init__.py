"""Answers to questions about samples: cached columns, the questions, and the processes that compute."""
