"""Answers of the service: columns kept ready, questions to them, and the processes that compute."""
