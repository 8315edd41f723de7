//! The machine: data folder, disk, memory, open files, COLMAP, address.

use std::{fs, io, path::Path, time::Duration};

use tokio::{net::TcpListener, time::timeout};

use super::finding::Finding;
use crate::{
    cli::{files, memory},
    jobs::reconstruction::{INSTALL, is_program, is_without_network},
    settings::Settings,
};

/// How long a server on the address may take to answer.
const ANSWER: Duration = Duration::from_secs(3);

/// The folder, or the one in which it will be made.
fn existing(folder: &Path) -> &Path {
    let there = folder.ancestors().find(|ancestor| ancestor.is_dir());
    there.unwrap_or_else(|| Path::new("."))
}

/// Whether files can be made, locked, renamed and removed in the data folder.
pub(super) fn data_folder(config: &Settings) -> Finding {
    let (folder, there) = (&config.data_dir, existing(&config.data_dir));
    let shown = folder.display();
    match probe(there) {
        Ok(()) if folder.is_dir() => Finding::ok("data folder", format!("{shown} can be written")),
        Ok(()) => Finding::ok("data folder", format!("{shown} does not exist yet; the server makes it")),
        Err(error) => {
            let advice = match error.kind() {
                io::ErrorKind::PermissionDenied => {
                    "give it to the account of the server (chown), or choose another data_dir"
                }
                io::ErrorKind::StorageFull => "free disk space",
                io::ErrorKind::Unsupported => "its file system cannot lock files: use a local one, or NFS version 4",
                _ => "check the disk and its mount",
            };
            let detail = format!("files cannot be made, locked and renamed in {}: {error}; {advice}", there.display());
            Finding::problem("data folder", detail)
        }
    }
}

fn probe(folder: &Path) -> io::Result<()> {
    let file = tempfile::Builder::new().prefix(".pinstack-doctor-").tempfile_in(folder)?;
    file.as_file().lock()?;
    file.as_file().sync_all()?;
    let renamed = file.path().with_extension("renamed");
    let (_, path) = file.keep().map_err(|error| error.error)?;
    let done = fs::rename(&path, &renamed);
    fs::remove_file(if done.is_ok() { &renamed } else { &path })?;
    done
}

/// Free disk space.
pub(super) fn disk(config: &Settings) -> Finding {
    let there = existing(&config.data_dir);
    let stat = match rustix::fs::statvfs(there) {
        Ok(stat) => stat,
        Err(error) => {
            let detail = format!("the free space of {} is unknown: {error}", there.display());
            return Finding::warning("disk", detail);
        }
    };
    let (free, total) = (stat.f_bavail.saturating_mul(stat.f_frsize), stat.f_blocks.saturating_mul(stat.f_frsize));
    let least = config.min_free_bytes;
    let shown = format!("{} of {} are free", gib(free), gib(total));
    if free <= least {
        let detail = format!(
            "{shown}, and min_free_bytes is {}: uploads are refused and jobs wait; free disk space or enlarge the disk",
            gib(least)
        );
        Finding::problem("disk", detail)
    } else if free < least.saturating_add(config.max_upload_bytes) {
        let detail = format!(
            "{shown}: less than one upload of the largest size ({}) beside min_free_bytes; free disk space",
            gib(config.max_upload_bytes)
        );
        Finding::warning("disk", detail)
    } else {
        Finding::ok("disk", shown)
    }
}

/// Whether the memory of the machine, or of its container, holds the budget of the jobs.
pub(super) fn memory(config: &Settings) -> Finding {
    let budget = config.memory_mb << 20;
    let Some((most, whose)) = memory::of_machine() else {
        return Finding::warning("memory", "the memory of this machine is unknown");
    };
    let shown = format!("{whose} has {}, the jobs may take {} (memory_mb)", gib(most), gib(budget));
    if config.workers > 0 && budget > most / 10 * 9 {
        Finding::warning("memory", format!("{shown}: a process takes nine tenths at most; lower memory_mb"))
    } else {
        Finding::ok("memory", shown)
    }
}

/// Whether the limit of open files holds `max_connections`.
pub(super) fn open_files(config: &Settings) -> Finding {
    let limit = rustix::process::getrlimit(rustix::process::Resource::Nofile).maximum;
    let fit = files::fitting(config.max_connections, config.workers, limit);
    let shown = limit.map_or_else(|| "without limit".to_owned(), |limit| format!("at most {limit}"));
    if fit < config.max_connections {
        let wanted = config.max_connections;
        let detail = format!(
            "{shown}: they hold {fit} connections, not the {wanted} of max_connections; raise the limit (ulimit -n, \
             LimitNOFILE of systemd), or lower max_connections"
        );
        return Finding::warning("open files", detail);
    }
    Finding::ok("open files", shown)
}

/// Whether workers here can reconstruct scans.
pub(super) fn colmap(config: &Settings) -> Finding {
    match (config.colmap(), &config.colmap) {
        (Some(found), _) if found.mesh_command.first().is_some_and(|program| !is_program(Path::new(program))) => {
            let program = found.mesh_command.first().map_or("", String::as_str);
            Finding::problem("colmap", format!("there is no program {program} to make a mesh: correct mesh_command"))
        }
        (Some(found), _) => {
            let network = if is_without_network() { "without a network" } else { "with the network of this machine" };
            Finding::ok("colmap", format!("reconstructions run {} {network}", found.program.display()))
        }
        (None, _) if config.workers == 0 => Finding::ok("colmap", "not needed: no jobs run here (workers=0)"),
        (None, Some(path)) => {
            let detail = format!(
                "there is no program {}: workers here leave reconstructions to others; correct the setting colmap",
                path.display()
            );
            Finding::problem("colmap", detail)
        }
        (None, None) => Finding::warning(
            "colmap",
            format!("not found: workers here run no reconstructions; to have them, {INSTALL}"),
        ),
    }
}

/// Whether the address is free, or a pinstack answers there.
pub(super) async fn address(config: &Settings) -> Option<Finding> {
    let listen = &config.listen;
    match TcpListener::bind(listen).await {
        Ok(_) => Some(Finding::ok("address", format!("{listen} is free; no server runs there"))),
        Err(error) if error.kind() == io::ErrorKind::AddrInUse => Some(in_use(listen).await),
        Err(error) => {
            let detail =
                format!("cannot listen on {listen}: {error}; choose an address of this machine and a free port");
            Some(Finding::problem("address", detail))
        }
    }
}

async fn in_use(listen: &str) -> Finding {
    let reachable = listen.replace("0.0.0.0:", "127.0.0.1:").replace("[::]:", "[::1]:");
    let asked = async {
        let client = reqwest::Client::builder().no_proxy().timeout(ANSWER).build().ok()?;
        let answer = client.get(format!("http://{reachable}/readyz")).send().await.ok()?;
        let status = answer.status();
        let body: serde_json::Value = answer.json().await.ok()?;
        body.get("ready").and_then(serde_json::Value::as_bool).map(|ready| (ready, status))
    };
    match timeout(ANSWER, asked).await.ok().flatten() {
        Some((true, _)) => Finding::ok("address", format!("a pinstack runs on {listen} and is ready")),
        Some((false, status)) => Finding::problem(
            "address",
            format!("a pinstack runs on {listen} and is not ready ({status}); GET /readyz and its log say why"),
        ),
        None => Finding::warning(
            "address",
            format!("another program listens on {listen}, or a pinstack with TLS; stop it, or choose another port"),
        ),
    }
}

/// A size for people.
fn gib(bytes: u64) -> String {
    format!("{:.1} GiB", bytes as f64 / f64::from(1 << 30))
}
