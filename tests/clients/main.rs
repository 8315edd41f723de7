//! The service with third-party programs: curl, zip, 7z, Python's zipfile, exiftool, COLMAP, tus clients, a browser,
//! Schemathesis, generated clients, R, Octave, reverse proxies, and linters of the OpenAPI document.
//!
//! Each test needs programs that may not be installed. It is ignored, with their names as the reason, unless all tests
//! are asked for (`--include-ignored`); it fails then where one is missing.

mod browser;
mod contract;
mod crash;
mod durability;
mod generated;
mod languages;
mod lint;
mod metadata;
mod photogrammetry;
mod point_in_time;
mod proxies;
mod proxy;
mod python;
mod run;
mod scan;
mod server;
mod tls;
mod tus;
mod web;
mod zips;

use run::run;
