//! The service on Postgres goes back to an earlier time, by the steps of docs/RECOVERY.md.

use std::{path::Path, process::Command};

use crate::run;

#[test]
#[ignore = "needs bash, curl, postgresql"]
fn a_service_on_postgres_goes_back_to_a_point_in_time_with_the_files_of_two_snapshots() {
    let folder = tempfile::tempdir().expect("a folder");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/clients/point_in_time.sh");
    run(Command::new("bash").arg(script).arg(env!("CARGO_BIN_EXE_pinstack")).arg(folder.path()));
}
