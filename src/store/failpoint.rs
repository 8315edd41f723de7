//! Failpoints: named steps of durability at which a test can kill the process, stop it, or report a full disk.
//!
//! `FAILPOINTS` arms them (`rows.enqueue=1*off->return(kill)`: killed at the second call). Outside of `cargo test` a
//! failpoint is empty: the crate `fail` is built without its failpoints then.
//!
//! Every call that creates, writes, syncs, renames, removes or commits something that clients rely on has a failpoint
//! before it. `tests/faults` reads the sources to verify that, and then breaks the service at each failpoint.

use std::io;

/// Arms the failpoints from the environment. To be called once, at the start of the process.
pub fn arm() {
    if fail::has_failpoints() {
        // never torn down: the failpoints stay armed as long as the process lives
        std::mem::forget(fail::FailScenario::setup());
    }
}

/// The failpoint `name`, directly before the step that it names.
///
/// # Errors
/// The fault that a test armed; never outside of tests.
#[cfg_attr(not(test), allow(unused_variables))]
pub fn step(name: &'static str) -> io::Result<()> {
    fail::fail_point!(name, |fault| inject(name, fault.as_deref().unwrap_or_default()));
    Ok(())
}

/// Injects a fault. Without failpoints the macro above is empty, and this is not used.
#[cfg_attr(not(test), allow(dead_code))]
fn inject(name: &str, fault: &str) -> io::Result<()> {
    match fault {
        // like SIGKILL: no destructor runs, no buffer is flushed
        "kill" => std::process::abort(),
        "stop" => {
            rustix::process::kill_process(rustix::process::getpid(), rustix::process::Signal::STOP)?;
            // the signal may stop another thread first: this one must not continue before it is stopped
            std::thread::sleep(std::time::Duration::from_millis(200));
            Ok(())
        }
        "full" => Err(io::ErrorKind::StorageFull.into()),
        other => Err(io::Error::other(format!("unknown fault '{other}' at failpoint {name}"))),
    }
}
