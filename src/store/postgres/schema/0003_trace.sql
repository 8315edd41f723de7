-- The trace that a job belongs to: traceparent of W3C and, after a blank, tracestate; null: no traces are exported.
ALTER TABLE jobs ADD COLUMN trace text;
