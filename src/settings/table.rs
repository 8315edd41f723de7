//! The table of settings.
//!
//! One row per setting: key, type, default, name of the value in `--help`, help text, range or rule, and the member of
//! [`Policy`] where requests depend on it. The environment variable is `PINSTACK_` and the key. After a change, the
//! test of the table in `docs/SETTINGS.md` says how to write it anew.

use std::{net::IpAddr, path::PathBuf, time::Duration};

use serde::{Deserialize, Serialize};

use super::{
    address_range::AddressRange,
    generate::{converted, settings},
    row::Row,
    rules::{is_base_url, is_host, is_mesh_command, is_origin, ranges, seconds_if_any},
    values::{Auth, LogFormat},
};
use crate::{
    store::{DatabaseUrl, gc::MOST_STORING, s3::S3Url},
    worker,
};
use pinstack_science::archive::ArchiveLimits;

/// Default address of the server.
pub const DEFAULT_LISTEN: &str = "127.0.0.1:8080";

settings! {
    values {
        listen: String = DEFAULT_LISTEN.to_owned(), "ADDR",
            "Address and port to listen on; port 0 takes a free port",
            check |settings| settings.listen.contains(':')
                => "must be an address and a port, for example 127.0.0.1:8080";
        data_dir: PathBuf = PathBuf::from("pinstack-data"), "DIR",
            "Folder of the database and the files";
        workers: usize = 1, "N",
            "Jobs that run at the same time; 0: serve the API only",
            in 0..=256, policy workers: usize;
        memory_mb: u64 = 4096, "MIB",
            "Memory budget of all running jobs together, MiB; a job that needs more runs alone",
            in 64..=16_777_216;
        lease_s: u64 = worker::Config::default().lease.as_secs(), "SECONDS",
            "Time without a heartbeat of its worker after which a job is taken over by another worker, seconds",
            in 2..=3600;
        max_upload_bytes: u64 = 64 << 30, "BYTES",
            "Largest upload, in one request or in pieces, bytes",
            at_least 1024, policy max_upload_bytes: u64;
        max_scan_bytes: u64 = 512 << 30, "BYTES",
            "Largest upload with all views of a scan, bytes",
            at_least 1024, policy max_scan_bytes: u64;
        queue_limit: u64 = 1000, "N",
            "Largest number of queued jobs",
            at_least 1, policy queue_limit: u64;
        min_free_bytes: u64 = 512 << 20, "BYTES",
            "Disk space that must stay free, bytes",
            policy min_free_bytes: u64;
        upload_reserve_bytes: u64 = 16 << 30, "BYTES",
            "Disk space that the open uploads of one token may reserve ahead of their bytes",
            policy upload_reserve_bytes: u64;
        max_open_uploads: u64 = 100, "N",
            "Largest number of open resumable uploads per token",
            at_least 1, policy max_open_uploads: u64;
        body_idle_timeout_s: u64 = 60, "SECONDS",
            "Timeout of a request body from which no data arrives, and of a client that does not read its answer, seconds",
            in 1..=86_400, policy body_idle_timeout: Duration = Duration::from_secs;
        upload_keep_s: u64 = 24 * 60 * 60, "SECONDS",
            "Time after which a resumable upload without new data expires, seconds",
            in 60..=31_536_000, policy upload_keep: Duration = Duration::from_secs;
        auth: Auth = Auth::default(), "WHEN",
            "When tokens are required: auto (once a token exists, and whenever other machines can reach the server), tokens or none";
        isolate_tokens: bool = false, "BOOL",
            "Show a token only the stacks, scans and uploads that it sent; tokens with the scope admin see all",
            clap(num_args = 0..=1, default_missing_value = "true"), policy isolate_tokens: bool;
        max_connections: usize = 1024, "N",
            "Largest number of connections; more have to wait",
            in 1..=1_000_000, policy max_connections: usize;
        header_timeout_s: u64 = 20, "SECONDS",
            "Time within which the head of a request must arrive, and idle time after which a connection is closed, seconds",
            in 1..=3600, policy header_timeout: Duration = Duration::from_secs;
        storage_presigned_s: u64 = 0, "SECONDS",
            "How long a signed URL of a file in the bucket is valid, for clients that ask for a redirect to it; 0: none, seconds",
            in 0..=604_800,
            check |settings| settings.storage_presigned_s == 0 || settings.storage_url.is_some() => "needs storage_url",
            policy presigned: Option<Duration> = seconds_if_any;
        reconstruction_minutes: u64 = 240, "MINUTES",
            "Longest time of a reconstruction, minutes",
            in 1..=100_000;
        log: String = "info".to_owned(), "FILTER",
            "Log filter: info, debug, or per module as in pinstack=debug,info";
        log_format: LogFormat = LogFormat::Text, "FORMAT",
            "Format of the log: text or json";
    }
    optional {
        database_url: DatabaseUrl, "SQLite in data_dir", "URL",
            "Postgres database of a service of several machines, postgres://user:password@host/name; other users of the \
             machine can read flags, so give it in the environment, in the file, or with database_url_file",
            check |settings| settings.database_url.as_ref().is_none_or(DatabaseUrl::is_valid)
                => "must be a URL of Postgres, for example postgres://user:password@host:5432/pinstack";
        database_url_file: PathBuf, "", "FILE",
            "File that contains the database_url, for example a secret of a container",
            check |settings| settings.database_url.is_none() || settings.database_url_file.is_none()
                => "and database_url exclude each other: give one of them";
        storage_url: S3Url, "files in data_dir", "URL",
            "Bucket of an S3-compatible store for uploads and results, s3://bucket/prefix; needs database_url",
            check |settings| settings.storage_url.as_ref().is_none_or(|url|
                url.is_valid() && (settings.database_url.is_some() || settings.database_url_file.is_some()))
                => "must look like s3://bucket or s3://bucket/prefix, and needs database_url";
        storage_endpoint: String, "AWS", "URL",
            "Server of the bucket, for example https://s3.lab.example:9000",
            check |settings| settings.storage_endpoint.as_ref().is_none_or(|url| is_origin(url.trim_end_matches('/')))
                => "must be scheme, host and port of a server: https://s3.lab.example:9000";
        storage_region: String, "AWS_REGION, or us-east-1", "NAME",
            "Region of the bucket";
        storage_ca_file: PathBuf, "", "FILE",
            "Certificates (PEM) to trust for the server of the bucket, besides those of public authorities";
        storage_credentials_file: PathBuf, "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or the role of the machine", "FILE",
            "File with the key of the bucket, as ~/.aws/credentials: lines aws_access_key_id and aws_secret_access_key";
        colmap: PathBuf, "colmap in PATH", "FILE",
            "COLMAP, the program for reconstructions; a worker without it leaves them to others";
        otlp_endpoint: String, "off", "URL",
            "Export traces to this collector of OpenTelemetry (OTLP over HTTP), for example http://127.0.0.1:4318",
            check |settings| settings.otlp_endpoint.as_ref().is_none_or(|url| is_base_url(url))
                => "must be the URL of a collector without a query, for example http://127.0.0.1:4318; /v1/traces is added";
        otlp_ca_file: PathBuf, "", "FILE",
            "Certificates (PEM) to trust for the collector, besides those of public authorities";
        keep_stacks_days: u32, "never", "DAYS",
            "Delete succeeded stacks this many days after their end, unless their own keep_days differs";
        keep_failed_days: u32, "never", "DAYS",
            "Delete failed and cancelled stacks and calibrations this many days after their end";
        keep_uploads_days: u32, "never", "DAYS",
            "Delete the zips of succeeded stacks and calibrations this many days after their end; the results remain";
        tls_cert: PathBuf, "", "FILE",
            "Serve TLS with this certificate, followed by its chain (PEM)",
            check |settings| settings.tls_cert.is_some() == settings.tls_key.is_some()
                => "and tls_key belong together: give both or none";
        tls_key: PathBuf, "", "FILE",
            "Private key of the certificate (PEM)";
        connections_per_client: usize, "a quarter of max_connections", "N",
            "Largest number of connections per address, and of requests in progress per token",
            check |settings| settings.connections_per_client.is_none_or(|most| (1..=settings.max_connections).contains(&most))
                => "must be 1 to max_connections",
            policy connections_per_client: usize;
        port_file: PathBuf, "", "FILE",
            "Write the address to this file once the server listens";
    }
    lists {
        trusted_proxies = vec!["127.0.0.0/8".to_owned(), "::1".to_owned()], "trusted-proxy", "ADDRESS",
            "Address or range (10.0.0.0/8) of a reverse proxy: its connections are not limited per address, and its \
             X-Forwarded-For, -Proto and -Prefix count; may be given several times",
            check |settings| settings.trusted_proxies.iter().all(|range| range.parse::<AddressRange>().is_ok())
                => "must be addresses or ranges of them: 172.18.0.2 or 10.0.0.0/8",
            policy trusted_proxies: Vec<AddressRange> = ranges;
        hosts = Vec::new(), "host", "NAME",
            "Host name under which browsers may use a service that requires no token, besides localhost and its address; may \
             be given several times",
            check |settings| settings.hosts.iter().all(|host| is_host(host))
                => "must be names as in a URL, for example lab-pc.example: no scheme, no port, no path",
            policy hosts: Vec<String>;
        cors_origins = Vec::new(), "cors-origin", "ORIGIN",
            "Origin whose pages may use the service from a browser, for example https://lab.example; may be given several \
             times",
            check |settings| settings.cors_origins.iter().all(|origin| is_origin(origin))
                => "must be origins as browsers send them: https://lab.example or http://localhost:3000, no path, no *",
            policy cors_origins: Vec<String>;
        mesh_command = Vec::new(), "mesh-command", "WORD",
            "Program that makes a mesh of each reconstruction, and its arguments, with {model}, {images}, {masks} and \
             {output}; one word each time it is given",
            check |settings| settings.mesh_command.is_empty() || is_mesh_command(&settings.mesh_command)
                => "must begin with the absolute path of a program, and have an argument with {output}";
    }
    beside {
        archive: ArchiveLimits = ArchiveLimits::default(),
            "Limits of a zip.";
        most_storing: Duration = MOST_STORING,
            "Longest time from the first blob that a request stores to the row of its job. No setting: it must be less than \
             the grace of garbage collection.";
        poll_interval: Duration = Duration::from_secs(1),
            "How often waiting requests read their job, because another process may change it.";
        reconstructs: bool = true,
            "Reconstructions are accepted: a worker has COLMAP, or may have it.";
        auth_required: bool = false,
            "Every request needs a token.";
        auth_once_there_are_tokens: bool = false,
            "Every request needs a token once one exists, made by this process or another.";
        listen: Option<IpAddr> = None,
            "The address that the server listens on; `None`: a loopback address.";
    }
}

impl Default for Policy {
    fn default() -> Self {
        Settings::default().into()
    }
}

impl Policy {
    /// Largest number of connections per address, and of requests in progress per token.
    pub fn client_share(&self) -> usize {
        self.connections_per_client.unwrap_or(self.max_connections / 4).max(1)
    }
}

/// The help of the flag of a setting.
fn help(key: &str) -> String {
    let defaults = serde_json::to_value(Settings::default()).unwrap_or_default();
    ROWS.iter().find(|row| row.key == key).map(|row| row.help(&defaults)).unwrap_or_default()
}
