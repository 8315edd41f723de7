//! Writes JPEG, PNG and TIFF.

mod jpeg;
mod png;
mod tiff;

pub use jpeg::{encode_jpeg, write_jpeg};
pub use png::encode_png;
pub use tiff::encode_tiff;
