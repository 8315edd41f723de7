//! Reverse proxies in front of the service, configured as the documentation says, at a host of its own and at a path of
//! a shared one, with a browser's requests by curl.

mod checks;
mod started;

use std::{env, process::Command, thread};

use crate::{run, server::Server};
use started::{APACHE, CADDY, HAPROXY, Kind, NGINX, Proxy};

/// Everything that clients do, through one proxy.
fn everything_works_behind(kind: &Kind) {
    let site = checks::Site::prepared();
    for at_a_path in [false, true] {
        checks::all(&site, &Proxy::start(kind, &site.server, at_a_path));
    }
}

#[test]
#[ignore = "needs nginx, curl, openssl, python3, httpx"]
fn everything_works_behind_nginx_as_documented() {
    everything_works_behind(&NGINX);
}

#[test]
#[ignore = "needs caddy, curl, openssl, python3, httpx"]
fn everything_works_behind_caddy_as_documented() {
    everything_works_behind(&CADDY);
}

#[test]
#[ignore = "needs haproxy, curl, openssl, python3, httpx"]
fn everything_works_behind_haproxy_as_documented() {
    everything_works_behind(&HAPROXY);
}

#[test]
#[ignore = "needs apache2, curl, openssl, python3, httpx"]
fn everything_works_behind_apache_as_documented() {
    everything_works_behind(&APACHE);
}

#[test]
#[ignore = "needs nginx, caddy, haproxy, apache2, curl, openssl"]
fn the_longest_wait_passes_every_proxy() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pinstack"));
    command.env("PINSTACK_WORKERS", "0").env("PINSTACK_HOSTS", "[\"pinstack.example\"]");
    let server = Server::start_by(command);
    let job = checks::queued(&server);
    thread::scope(|scope| {
        for kind in [NGINX, CADDY, HAPROXY, APACHE] {
            let (server, job) = (&server, job.as_str());
            scope.spawn(move || {
                let proxy = Proxy::start(&kind, server, false);
                let mut curl = proxy.curl();
                curl.args(["-H", "Prefer: wait=50", "-w", "\n%{http_code} %{time_total}"]);
                let told = run(curl.arg(proxy.at(job)));
                let (status, seconds) =
                    told.rsplit('\n').next().and_then(|end| end.split_once(' ')).expect("two words");
                assert_eq!(status, "200", "{}: {told}", kind.name);
                assert!(seconds.parse::<f64>().expect("a number") > 49.0, "{}: {told}", kind.name);
            });
        }
    });
}

/// Sends as many zeros as `PINSTACK_TEST_PROXY_BYTES` says, by POST and in pieces, through every proxy.
#[test]
#[ignore = "more cases of a test"]
fn more_bytes_pass_every_proxy() {
    let bytes = env::var("PINSTACK_TEST_PROXY_BYTES").ok().and_then(|text| text.parse().ok()).unwrap_or(1 << 30);
    let site = checks::Site::prepared();
    for kind in [NGINX, CADDY, HAPROXY, APACHE] {
        let proxy = Proxy::start(&kind, &site.server, false);
        checks::sign_in(&site, &proxy);
        checks::zeros_pass(&proxy, bytes);
    }
}
