//! The order of durability (bytes, file sync, rename, row, answer), observed in the system calls of the server.

use std::{collections::HashMap, fs, path::Path};

use pinstack_science::synth::Rig;

use crate::{
    server::{LOOK, Server, write_stack_of},
    tus,
};

/// A system call with its start and its return.
struct Call {
    text: String,
    begun: usize,
    ended: usize,
}

/// The calls of a trace in the order of their returns. A call interrupted by another thread takes two lines of the
/// trace.
fn calls(trace: &str) -> Vec<Call> {
    let mut unfinished: HashMap<&str, (String, usize)> = HashMap::new();
    let mut calls = Vec::new();
    for (line_number, line) in trace.lines().enumerate() {
        let Some((thread, rest)) = line.split_once(' ') else { continue };
        let rest = rest.trim_start();
        if let Some(begun) = rest.strip_suffix("<unfinished ...>") {
            unfinished.insert(thread, (begun.to_owned(), line_number));
        } else if rest.starts_with("<... ") {
            let Some((text, begun)) = unfinished.remove(thread) else { continue };
            calls.push(Call { text: format!("{text}{rest}"), begun, ended: line_number });
        } else {
            calls.push(Call { text: rest.to_owned(), begun: line_number, ended: line_number });
        }
    }
    calls
}

/// Checks that the steps occur in this order, each started after the previous one returned.
fn in_order(trace: &str, steps: &[(&str, &str)]) {
    let calls = calls(trace);
    let mut after = 0;
    for (call, on) in steps {
        let wanted = |c: &&Call| c.text.starts_with(call) && c.text.contains(on) && (after == 0 || c.begun > after);
        let found = calls.iter().filter(wanted).min_by_key(|c| c.ended);
        let found = found.unwrap_or_else(|| panic!("no {call} on {on} after line {after} of the trace:\n{trace}"));
        after = found.ended;
    }
}

/// The trace from `from` on, once the answer is written: the call that writes it has returned.
fn traced(file: &Path, from: usize, answer: &str) -> String {
    loop {
        let text = String::from_utf8_lossy(&fs::read(file).expect("the trace")).into_owned();
        let whole_lines = text[from..].rfind('\n').map_or("", |end| &text[from..from + end + 1]);
        if calls(whole_lines).iter().any(|call| call.text.contains(answer)) {
            return whole_lines.to_owned();
        }
        std::thread::sleep(LOOK);
    }
}

#[test]
#[ignore = "needs curl, strace"]
fn bytes_are_synced_before_the_row_and_the_row_before_the_answer() {
    let server = Server::start_traced();
    let rig = Rig::sized(240, 160, 4);
    let zip = server.folder.path().join("stack.zip");
    write_stack_of(&rig, &zip);
    server.put_profile(&rig);
    let trace = server.folder.path().join("trace");
    let length = || fs::metadata(&trace).expect("the trace").len() as usize;
    let bytes = fs::read(&zip).expect("the zip");

    // the first piece of an upload
    let path = tus::begin(&server, bytes.len());
    let piece = server.folder.path().join("piece");
    fs::write(&piece, &bytes[..5_000]).expect("a piece");
    let from = length();
    tus::send(&server, &path, 0, &piece);
    let row = [("pwrite64", "-wal>"), ("fsync", "-wal>")];
    let synced = [("pwrite64", ".part>"), ("fdatasync", ".part>")];
    let first = traced(&trace, from, "HTTP/1.1 204");
    in_order(&first, &[&[("fsync", "/partial>")], &synced[..], &row[..], &[("write", "HTTP/1.1 204")]].concat());

    // the last one, which makes the job
    fs::write(&piece, &bytes[5_000..]).expect("a piece");
    let from = length();
    tus::send(&server, &path, 5_000, &piece);
    let published = [("fsync", ".part>"), ("rename", "/uploads/"), ("fsync", "/blobs/uploads>")];
    let last = traced(&trace, from, "HTTP/1.1 204");
    in_order(&last, &[&synced[..], &row, &published, &row, &[("write", "HTTP/1.1 204")]].concat());

    // all in one request
    let from = length();
    let zip = zip.to_str().expect("a plain path");
    server.curl(&["-X", "POST", "-T", zip, "-H", "Content-Type: application/zip"], "/v1/stacks?rig=rig&lens=lens");
    let published = [("fsync", "/upload-"), ("rename", "/uploads/"), ("fsync", "/blobs/uploads>")];
    let whole = traced(&trace, from, "HTTP/1.1 202");
    in_order(&whole, &[&[("write", "/upload-")], &published[..], &row, &[("write", "HTTP/1.1 202")]].concat());
}

#[test]
fn a_trace_in_the_wrong_order_is_detected() {
    let right = "7 write(9</d/x.part>, \"..\", 2) = 2\n7 fdatasync(9</d/x.part> <unfinished ...>\n8 write(1, \"a\", 1) = 1\n\
                 7 <... fdatasync resumed>) = 0\n7 pwrite64(4</d/rows-wal>, \"..\", 2, 0) = 2\n";
    let wrong = "7 write(9</d/x.part>, \"..\", 2) = 2\n7 fdatasync(9</d/x.part> <unfinished ...>\n\
                 8 pwrite64(4</d/rows-wal>, \"..\", 2, 0) = 2\n7 <... fdatasync resumed>) = 0\n";
    let steps = [("write", ".part>"), ("fdatasync", ".part>"), ("pwrite64", "-wal>")];
    in_order(right, &steps);
    assert!(std::panic::catch_unwind(|| in_order(wrong, &steps)).is_err());
}
