"""The header Idempotency-Key: what is sent again changes nothing, and has the first request's answer."""
