//! Jobs of the service on this machine, without a server and its store: what `pinstack fuse` and `pinstack calibrate`
//! share.

mod calibration;
mod input;
mod profile;
mod progress;
mod run;
mod words;

pub(super) use calibration::{Calibrated, calibrate, json_of, write_report};
pub(super) use input::{View, name_of, views};
pub(super) use profile::{ProfileFlags, UsedProfile, read as read_profile};
pub(super) use progress::{Bar, is_stopped, stop_by_signals};
pub(super) use run::{context, fitting, no_upload};
