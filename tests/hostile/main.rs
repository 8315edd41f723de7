//! Hostile and odd input: the corpus that the fuzzer found, known decompression bombs, and a table of odd pictures.

mod bombs;
mod forms;
mod members;
mod odd_colours;
mod odd_data;
mod odd_files;
mod odd_pictures;
mod peak;
mod pictures;
mod replay;
mod targets;
mod truncated;
mod zips;
