"""Heavy work, behind `concurrent.futures.Executor`: worker processes, and what they do."""
