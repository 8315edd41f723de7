//! The comparison in docs/POSES.md: the poses that COLMAP finds in fused and in ideal pictures. Needs curl and COLMAP.
//!
//! ```text
//! SCAN_CASE="seed=1 lens=fixed alignment=calibrated" cargo bench --bench poses -- case
//! SCAN_SEEDS=1,2,3 cargo bench --bench poses -- specimens
//! ```
//!
//! The first runs one case, named by `SCAN_CASE`, and keeps pictures and model in `SCAN_FOLDER`. The second compares
//! fused with ideal pictures over the specimens in `SCAN_SEEDS`; `SCAN_CASE` has further settings. Minutes per case.

#[path = "poses/case.rs"]
mod case;
#[allow(dead_code, reason = "the test uses more of it")]
#[path = "../tests/clients/scan/colmap.rs"]
mod colmap;
#[path = "../tests/clients/scan/pooled.rs"]
mod pooled;
#[path = "../tests/clients/run.rs"]
mod run;
#[allow(dead_code, reason = "the test uses more of it")]
#[path = "../tests/clients/server.rs"]
mod server;
#[allow(dead_code, reason = "the test uses more of it")]
#[path = "../tests/clients/scan/setup.rs"]
mod setup;

use std::path::PathBuf;

use case::Case;
use pooled::{Pair, pooled};
use run::run;

/// Observations with a larger error of reprojection are left out, px, as in the test.
const LIMIT_PX: f64 = 1.0;

fn main() {
    let settings = std::env::var("SCAN_CASE").unwrap_or_default();
    match std::env::args().nth(1).as_deref() {
        Some("case") => {
            let case = Case::of(&settings);
            println!("{case}: {}", case.run(std::env::var_os("SCAN_FOLDER").map(PathBuf::from).as_deref()));
        }
        Some("specimens") => specimens(&settings),
        _ => println!("say which: case, or specimens"),
    }
}

/// Fused against ideal pictures over several specimens.
fn specimens(settings: &str) {
    let seeds = std::env::var("SCAN_SEEDS").expect("SCAN_SEEDS is a list of seeds, such as 1,2,3");
    let found = |seed: &str, alignment: &str| {
        let case = Case::of(&format!("limit={LIMIT_PX} {settings} seed={seed} alignment={alignment}"));
        let accuracy = case.run(None);
        println!("{case}: {accuracy}");
        accuracy
    };
    let pairs: Vec<Pair> =
        seeds.split(',').map(|seed| Pair { ideal: found(seed, "ideal"), fused: found(seed, "calibrated") }).collect();
    let [radius, pan, tilt] = pooled(&pairs);
    println!("{} specimens, fused over ideal: radius {radius}, pan step {pan}, tilt step {tilt}", pairs.len());
}
