//! The Debian package: made of the program under test, installed and purged in a view of this machine that is thrown away.

use std::path::Path;
use std::process::{Command, Output};

/// What it needs: the tools that make it, and what installing looks at.
const TOOLS: [&str; 7] =
    ["dpkg-deb", "dpkg-shlibdeps", "dpkg-gencontrol", "strip", "unshare", "systemd-analyze", "man"];

fn run(command: &mut Command) -> Output {
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{command:?}: {said}{}", String::from_utf8_lossy(&output.stderr));
    output
}

#[test]
fn the_package_is_installed_upgraded_and_purged_and_leaves_nothing() {
    let is_there = |tool: &&str| {
        std::env::split_paths(&std::env::var_os("PATH").unwrap()).any(|folder| folder.join(tool).exists())
    };
    if let Some(missing) = TOOLS.iter().find(|tool| !is_there(tool)) {
        println!("SKIPPED: no {missing}");
        return;
    }
    if !rustix::process::geteuid().is_root() {
        println!("SKIPPED: not root, who alone installs packages");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (out, view) = (folder.path().join("out"), folder.path().join("view"));
    std::fs::create_dir(&view).unwrap();
    let mut make = Command::new(crate::deploy().join("package.sh"));
    // Whoever downloads it wants it small, this test wants it soon.
    make.env("DPKG_DEB_COMPRESSOR_TYPE", "gzip").env("DPKG_DEB_COMPRESSOR_LEVEL", "1");
    run(make.args(["--binary", env!("CARGO_BIN_EXE_cyclorama"), "--out"]).arg(&out));
    let made: Vec<_> = std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().path()).collect();
    let [package] = &made[..] else { panic!("{made:?}") };
    let name = package.file_name().unwrap().to_str().unwrap();
    assert!(name.starts_with(concat!("cyclorama_", env!("CARGO_PKG_VERSION"), "-1_")), "{name}");
    conffiles_are_what_goes_to_etc(package);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/deployment/install.sh");
    let mut install = Command::new("unshare");
    let install = install.args(["--mount", "--propagation", "private", "bash"]).arg(script).arg(package).arg(&view);
    let said = run(install.env("DEBIAN_FRONTEND", "noninteractive"));
    println!("{name}: {}", String::from_utf8_lossy(&said.stdout));
}

/// Else an upgrade would overwrite what was changed there.
fn conffiles_are_what_goes_to_etc(package: &Path) {
    let listed = run(Command::new("dpkg-deb").arg("--contents").arg(package)).stdout;
    let listed = String::from_utf8(listed).unwrap();
    let mut settings: Vec<_> = listed
        .lines()
        .filter_map(|line| line.split(" ./").nth(1))
        .filter(|path| path.starts_with("etc/") && !path.ends_with('/'))
        .map(|path| format!("/{path}"))
        .collect();
    settings.sort();
    let said = run(Command::new("dpkg-deb").arg("--info").arg(package).arg("conffiles")).stdout;
    assert_eq!(settings, String::from_utf8(said).unwrap().lines().collect::<Vec<_>>(), "what goes to /etc");
}
