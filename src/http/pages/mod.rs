//! HTML pages: pure functions from results to text. They know no request and no response.

pub mod calibration_report;
