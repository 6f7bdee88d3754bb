//! Units, by `systemd-analyze`.

use std::process::Command;

#[test]
fn units_are_right_and_keep_their_services_in() {
    if Command::new("systemd-analyze").arg("--version").output().is_err() {
        println!("SKIPPED: no systemd-analyze");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let units = std::fs::read_dir(crate::deploy().join("systemd")).unwrap().map(|entry| entry.unwrap().path());
    let units: Vec<_> = units.filter(|path| path.extension().is_some_and(|kind| kind == "service")).collect();
    assert_eq!(units.len(), 3, "manager, board and compositor");
    for unit in units {
        // It is looked whether the program is there.
        let text =
            std::fs::read_to_string(&unit).unwrap().replace("/usr/bin/cyclorama", env!("CARGO_BIN_EXE_cyclorama"));
        let copy = folder.path().join(unit.file_name().unwrap());
        std::fs::write(&copy, text).unwrap();
        let verified = Command::new("systemd-analyze").args(["--man=no", "verify"]).arg(&copy).output().unwrap();
        let said = String::from_utf8_lossy(&verified.stderr);
        // An unknown key is only a word of warning to systemd.
        assert!(verified.status.success() && said.is_empty(), "{}: {said}", unit.display());
        // 10 is a service that may do everything, and 2.0 among the strictest that there are.
        let limits = ["security", "--offline=true", "--threshold=20"];
        let judged = Command::new("systemd-analyze").args(limits).arg(&copy).output().unwrap();
        let said = String::from_utf8_lossy(&judged.stdout);
        assert!(judged.status.success(), "{}: {said}", unit.display());
        println!("{}: {}", unit.display(), said.lines().last().unwrap_or_default());
    }
}
