//! Tests of the API over HTTP. Each test has a server of its own on a free port. Tests act as the workers, so that
//! nothing waits for a clock.

mod access;
mod app;
mod bad_requests;
mod browsers;
mod configuration;
mod connections;
mod disk_budget;
mod doctor;
mod exposition;
mod forms;
mod guide;
mod lifecycle;
mod logs;
mod names;
mod optics;
mod pages;
mod pages_of_tokens;
mod poses;
mod problem_examples;
mod process;
mod profile_files;
mod profiles;
mod profiles_elsewhere;
mod queue;
mod reports;
mod reruns;
mod results;
mod scans;
mod service;
mod stack_input;
mod tiles;
mod token_command;
mod uploads;
mod watching;
mod wrong_zips;
