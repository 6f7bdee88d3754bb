//! As much of kustomize as the manifests use: resources, and JSON patches of one object each.

use json_patch::{Patch, patch};
use serde::Deserialize;
use serde_json::Value;
use std::path::Path;
use std::process::Command;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(non_snake_case, reason = "the file's own word")]
struct Kustomization {
    apiVersion: String,
    kind: String,
    resources: Vec<String>,
    #[serde(default)]
    patches: Vec<Change>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Change {
    target: Target,
    patch: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Target {
    kind: String,
    name: String,
}

/// The objects that `kubectl apply -k FOLDER` would hand over.
pub(crate) fn build(folder: &Path) -> Vec<Value> {
    let file = folder.join("kustomization.yaml");
    let kustomization: Kustomization = serde_yaml_ng::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
    let version = (kustomization.apiVersion.as_str(), kustomization.kind.as_str());
    assert_eq!(version, ("kustomize.config.k8s.io/v1beta1", "Kustomization"), "{}", file.display());
    let mut objects = Vec::new();
    for resource in &kustomization.resources {
        let path = folder.join(resource);
        if path.is_dir() {
            objects.extend(build(&path));
        } else {
            objects.extend(documents(&path));
        }
    }
    for Change { target, patch: changes } in kustomization.patches {
        let wanted = |object: &&mut Value| object["kind"] == target.kind && object["metadata"]["name"] == target.name;
        let object = objects.iter_mut().find(wanted);
        let object = object.unwrap_or_else(|| panic!("{}: no {} {}", file.display(), target.kind, target.name));
        let changes: Value = serde_yaml_ng::from_str(&changes).unwrap();
        let changes: Patch = serde_json::from_value(changes).unwrap();
        patch(object, &changes).unwrap_or_else(|error| panic!("{}: {}: {error}", file.display(), target.name));
    }
    objects
}

fn documents(file: &Path) -> Vec<Value> {
    parse(&std::fs::read_to_string(file).unwrap(), &file.display().to_string())
}

fn parse(text: &str, from: &str) -> Vec<Value> {
    let documents = serde_yaml_ng::Deserializer::from_str(text).map(Value::deserialize);
    documents.map(|document| document.unwrap_or_else(|error| panic!("{from}: {error}"))).collect()
}

/// What is built here must be what `kubectl` builds, or the other tests look at something that no cluster is given.
#[test]
fn overlays_are_built_as_kubectl_builds_them() {
    // Before 1.27 it had a kustomize that didn't know `patches`.
    let version = Command::new("kubectl").args(["version", "--client", "--output", "json"]).output();
    let version: Option<Value> = version.ok().and_then(|output| serde_json::from_slice(&output.stdout).ok());
    let minor = version.as_ref().and_then(|version| version["clientVersion"]["minor"].as_str());
    let minor: Option<u32> = minor.and_then(|minor| minor.trim_end_matches('+').parse().ok());
    if minor < Some(27) {
        println!("SKIPPED: no kubectl of 1.27 or later");
        return;
    }
    for name in crate::kubernetes::FOLDERS {
        let folder = crate::deploy().join("kubernetes").join(name);
        let built = Command::new("kubectl").arg("kustomize").arg(&folder).output().unwrap();
        assert!(built.status.success(), "{name}: {}", String::from_utf8_lossy(&built.stderr));
        let mut theirs = parse(&String::from_utf8(built.stdout).unwrap(), name);
        let mut ours = build(&folder);
        let place = |object: &Value| format!("{} {}", object["kind"], object["metadata"]["name"]);
        theirs.sort_by_key(place);
        ours.sort_by_key(place);
        let places = |objects: &[Value]| objects.iter().map(place).collect::<Vec<_>>();
        assert_eq!(places(&ours), places(&theirs), "{name}");
        for (ours, theirs) in ours.iter().zip(&theirs) {
            assert_eq!(ours, theirs, "{name}: {}", place(ours));
        }
        println!("{name}: {} objects", ours.len());
    }
}
