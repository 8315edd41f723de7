//! Parses the PowerShell lines of the documents with a grammar; the tests cannot run PowerShell.

use std::{fs, process::Command};

/// Prints the syntax errors in the PowerShell blocks of the given files.
const CHECK: &str = r#"
import re, sys
import tree_sitter, tree_sitter_powershell
parser = tree_sitter.Parser(tree_sitter.Language(tree_sitter_powershell.language()))
def faults(node):
    if node.is_error or node.is_missing:
        yield node
    for child in node.children:
        yield from faults(child)
blocks = [b for name in sys.argv[1:] for b in re.findall(r"```powershell\n(.*?)```", open(name).read(), re.S)]
for block in blocks:
    for node in faults(parser.parse(block.encode()).root_node):
        print("not PowerShell:", block.encode()[node.start_byte:node.end_byte].decode() or node.type)
print(len(blocks), "blocks")
"#;

fn check(files: &[&str]) -> String {
    let output = Command::new("python3").args(["-c", CHECK]).args(files).current_dir(super::project()).output();
    let output = output.expect("python3 can be started");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("UTF-8")
}

#[test]
#[ignore = "needs python3, tree-sitter, tree-sitter-powershell"]
fn the_powershell_lines_of_the_documents_are_valid() {
    let told = check(&["README.md", "docs/WINDOWS.md"]);
    assert_eq!(told.trim(), "2 blocks", "{told}");
    let folder = tempfile::tempdir().expect("a folder");
    let torn = folder.path().join("torn.md");
    fs::write(&torn, "```powershell\nforeach ($zip in Get-ChildItem views {\n```\n").expect("a file");
    assert!(check(&[&torn.to_string_lossy()]).contains("not PowerShell"), "a torn block is seen");
}
