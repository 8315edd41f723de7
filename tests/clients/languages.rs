//! The lines of docs/OTHER_LANGUAGES.md: R and Octave run them against the service, and a grammar reads those for
//! MATLAB.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use crate::{
    run,
    server::{Server, small_rig, write_slices},
};

const PAGE: &str = "docs/OTHER_LANGUAGES.md";

/// The blocks of a language on the page, with the address of `server`.
fn blocks(language: &str, server: &Server) -> Vec<String> {
    let page = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(PAGE)).expect("UTF-8");
    let found: Vec<String> = page
        .split(&format!("\n```{language}\n"))
        .skip(1)
        .map(|rest| rest.split("\n```").next().unwrap_or_default().replace("http://127.0.0.1:8080", &server.url))
        .collect();
    assert_eq!(found.len(), 2, "{PAGE} has other {language} lines than this test knows");
    found
}

/// A folder with `stack.zip`, and a server with the rig and lens of the page.
fn prepared() -> (Server, PathBuf) {
    let server = Server::start();
    let folder = server.folder.path().join("here");
    write_slices(&folder);
    run(Command::new("7z").args(["a", "-bd", "-tzip", "-mx0", "stack.zip", "front", "back"]).current_dir(&folder));
    server.put_profile(&small_rig());
    let profile = server.curl(&[], "/v1/profiles/rig/lens/export").to_string();
    let sent = ["-X", "POST", "-H", "Content-Type: application/json", "-d", &profile];
    server.curl(&sent, "/v1/profiles/bench-1/macro65-1x/import");
    (server, folder)
}

/// Runs a script with what the page does not show: checks of the names that it leaves.
fn run_script(program: &str, arguments: &[&str], script: &str, folder: &Path) -> String {
    let file = folder.join("script");
    fs::write(&file, script).expect("a file");
    run(Command::new(program).args(arguments).arg(&file).current_dir(folder))
}

#[test]
#[ignore = "needs curl, 7z, R, httr2"]
fn r_sends_a_stack_and_gets_its_image_and_its_metrics_as_data_frames() {
    let (server, folder) = prepared();
    let scan =
        ["-X", "PUT", "-H", "Content-Type: application/json", "-d", r#"{"rig": "bench-1", "lens": "macro65-1x"}"#];
    server.curl(&scan, "/v1/scans/beetle");
    let view = ["-X", "POST", "-T", "stack.zip", "-H", "Content-Type: application/zip", "-H", "Prefer: wait=60"];
    let view = view.map(|word| if word == "stack.zip" { folder.join(word).display().to_string() } else { word.into() });
    let view: Vec<&str> = view.iter().map(String::as_str).collect();
    server.curl(&view, "/v1/stacks?rig=bench-1&lens=macro65-1x&scan=beetle&pan_deg=20&tilt_deg=15");

    let checks = r#"
stopifnot(identical(dim(image), c(160L, 240L, 4L)), any(image[, , 4] == 0), any(image[, , 4] == 1))
stopifnot(is.data.frame(slices), nrow(slices) == 4, is.numeric(slices$sharpness), metrics$alignment$residual_p95_px < 1)
stopifnot(nrow(views) == 1, views$pan_deg == 20, views$tilt_deg == 15)
refused <- tryCatch(
  api |> req_url_path_append("v1/stacks") |> req_url_query(rig = "bench-9", lens = "none") |>
    req_body_file("stack.zip", "application/zip") |> req_perform(),
  error = conditionMessage)
stopifnot(grepl("there is no profile for rig 'bench-9'", refused))
"#;
    run_script("Rscript", &["--vanilla"], &format!("{}\n{checks}", blocks("r", &server).join("\n")), &folder);
}

#[test]
#[ignore = "needs curl, 7z, octave-cli"]
fn octave_sends_a_stack_and_gets_its_image_and_its_metrics_as_structs() {
    let (server, folder) = prepared();
    let lines = &blocks("matlab", &server)[0];
    let checks = "
assert(isequal(size(image), [160 240 3])); assert(isequal(size(alpha), [160 240]));
assert(any(alpha(:) == 0) && any(alpha(:) == 255));
assert(residual < 1); assert(numel(sharpness) == 4); assert(all(sharpness > 0));
";
    run_script("octave-cli", &["--norc", "--quiet"], &format!("{lines}\n{checks}"), &folder);

    let refused = lines.replace("rig=bench-1", "rig=bench-9");
    let caught = format!(
        "try\n{refused}\nerror('it was accepted');\ncatch problem\nassert(strcmp(problem.identifier, 'pinstack:refused'));\n\
         assert(~isempty(strfind(problem.message, 'bench-9')));\nend\n"
    );
    // a new key: with the first one the service would say that the request is another
    let caught = caught.replace("beetle-view-001", "beetle-view-002");
    run_script("octave-cli", &["--norc", "--quiet"], &caught, &folder);
}

/// Prints the syntax errors in a file with lines for MATLAB.
const GRAMMAR: &str = r#"
import sys
import tree_sitter, tree_sitter_matlab
parser = tree_sitter.Parser(tree_sitter.Language(tree_sitter_matlab.language()))
text = open(sys.argv[1], "rb").read()
def faults(node):
    if node.is_error or node.is_missing:
        yield node
    for child in node.children:
        yield from faults(child)
for node in faults(parser.parse(text).root_node):
    print(f"line {node.start_point[0] + 1}:", text[node.start_byte:node.end_byte].decode() or node.type)
"#;

#[test]
#[ignore = "needs python3, tree-sitter-matlab"]
fn the_lines_for_matlab_are_valid() {
    let server = Server::start_without_workers();
    let file = server.folder.path().join("lines.m");
    let check = |text: &str| {
        fs::write(&file, text).expect("a file");
        run(Command::new("python3").args(["-c", GRAMMAR]).arg(&file))
    };
    for block in blocks("matlab", &server) {
        assert_eq!(check(&block), "", "{block}");
    }
    assert!(!check("while any(stack.state == [\"queued\"\n  x = 1;\n").is_empty(), "torn lines are seen");
}
