//! How outside programs are started: without a network, and killed when this process is killed, where the system allows
//! it.

use std::{
    ffi::OsString,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::LazyLock,
};

use super::program::in_path;

/// Arguments of `unshare` (util-linux): a network of its own that reaches nothing, as the same user.
const NO_NETWORK: [&str; 4] = ["--user", "--map-current-user", "--net", "--"];
/// Arguments of `setpriv` (util-linux): killed when its parent is.
const DIES_WITH_PARENT: [&str; 3] = ["--pdeathsig", "KILL", "--"];

/// `unshare`, where it may make namespaces: some systems and most containers forbid it. Asked once.
static UNSHARE: LazyLock<Option<PathBuf>> = LazyLock::new(|| {
    let unshare = in_path("unshare")?;
    let mut command = Command::new(&unshare);
    command.args(NO_NETWORK).arg("true").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success()).then_some(unshare)
});

/// Whether outside programs have no network.
pub fn is_without_network() -> bool {
    UNSHARE.is_some()
}

/// A command that runs `program`, whose arguments follow. The process keeps its number.
pub(super) fn command_of(program: &Path) -> Command {
    let mut words: Vec<OsString> = Vec::new();
    if let Some(unshare) = &*UNSHARE {
        words.push(unshare.into());
        words.extend(NO_NETWORK.map(OsString::from));
    }
    // within `unshare`, which would clear the signal
    if let Some(setpriv) = in_path("setpriv") {
        words.push(setpriv.into());
        words.extend(DIES_WITH_PARENT.map(OsString::from));
    }
    words.push(program.into());
    let mut command = Command::new(&words[0]);
    command.args(&words[1..]);
    command
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(target_os = "linux")]
    #[test]
    fn a_program_is_in_a_network_of_its_own_where_the_system_allows_it() {
        let network = |output: std::io::Result<std::process::Output>| {
            String::from_utf8(output.expect("readlink runs").stdout).expect("text")
        };
        let ours = network(Command::new("readlink").arg("/proc/self/ns/net").output());
        let its = network(command_of(Path::new("readlink")).arg("/proc/self/ns/net").output());
        assert!(ours.starts_with("net:") && its.starts_with("net:"), "{ours} {its}");
        assert_eq!(ours != its, is_without_network());
    }
}
