"""What every request passes and every answer has: limits, headers, who asks, problems, audit, metrics."""
