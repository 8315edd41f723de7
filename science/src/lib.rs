//! Calibration, fusion, segmentation and metrics of focus stacks.
//!
//! A *focus stack* is a set of slices of one view, each taken with the sensor (or the lens) at another rail position. A
//! *calibration profile* holds one homography per slice, which maps slice pixels to pixels of the reference slice. Fusing
//! the warped slices gives one image that is still a perspective image, which is what structure from motion needs (Li and
//! Nguyen, DICTA 2019).
//!
//! All functions are pure: no async runtime, no database, no clock. A slice comes in through [`imaging::Slices`], progress
//! and cancellation through [`types::Control`].

#![warn(unreachable_pub)]

pub mod imaging;
pub mod types;

pub mod calibration;
pub mod fusion;
pub mod quality;
pub mod segmentation;
pub mod synth;

pub mod archive;
