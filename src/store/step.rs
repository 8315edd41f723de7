//! Named steps of durability. At each of them a test can kill the process, fill the disk or stop the process, as
//! `FAILPOINTS` says (`step=1*off->return(kill)`: at its second time). Outside of `cargo test` a step is nothing:
//! the crate `fail` is built without its failpoints then.
//!
//! Whatever makes, writes, syncs, renames, removes or commits something that clients count on has a step before it;
//! `tests/faults` reads the source to see that, and then breaks the service at each step.

use std::io;

/// Arms the steps by the environment; once, when the process begins.
pub fn arm() {
    if fail::has_failpoints() {
        // never torn down: the steps stay armed as long as the process lives
        std::mem::forget(fail::FailScenario::setup());
    }
}

/// The step `name` comes next.
///
/// # Errors
/// What a test wants to happen here; never outside of tests.
#[cfg_attr(not(test), allow(unused_variables))]
pub fn step(name: &'static str) -> io::Result<()> {
    fail::fail_point!(name, |fault| broken(name, fault.as_deref().unwrap_or_default()));
    Ok(())
}

/// Lets happen what a test asked for. Without failpoints the macro above is nothing, and this is not used.
#[cfg_attr(not(test), allow(dead_code))]
fn broken(name: &str, fault: &str) -> io::Result<()> {
    match fault {
        // like SIGKILL: no destructor runs, no buffer is flushed
        "kill" => std::process::abort(),
        "stop" => {
            rustix::process::kill_process(rustix::process::getpid(), rustix::process::Signal::STOP)?;
            // the signal may reach another thread first: this one must not take the step before it stops
            std::thread::sleep(std::time::Duration::from_millis(200));
            Ok(())
        }
        "full" => Err(io::ErrorKind::StorageFull.into()),
        other => Err(io::Error::other(format!("the fault '{other}' at {name} is unknown"))),
    }
}
