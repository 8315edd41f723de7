//! Planning a capture: depth of focus and of field, rail positions, printable dot targets.
