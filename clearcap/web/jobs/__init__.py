"""Jobs: the processes that compute for pages and calls, the questions that they answer, and cached columns."""
