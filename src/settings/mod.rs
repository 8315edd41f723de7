//! The settings of the service: one row per setting in [`table`], and all that follows from the row.
//!
//! In: flags, `PINSTACK_*` environment variables and a TOML file. Out: checked [`Settings`], and the [`Policy`] that
//! requests depend on. [`generate`] makes both structs, the flags, their help, the checks, and the table of
//! `docs/SETTINGS.md` from the rows. A new setting is a row and its place of use.

mod address_range;
mod environment;
mod generate;
mod load;
mod parts;
mod row;
mod rules;
mod table;
#[cfg(test)]
mod tests;
mod values;

pub use address_range::AddressRange;
pub use table::{DEFAULT_LISTEN, Flags, Policy, Settings};
pub use values::{Auth, LogFormat};
