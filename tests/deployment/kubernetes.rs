//! Manifests, by Kubernetes' own types: each object is read as what it says to be and written again, and nothing may have got lost, as a
//! misspelt key would. And what refers to something finds it.

use crate::kustomize::build;
use k8s_openapi::api::apps::v1::{Deployment, StatefulSet};
use k8s_openapi::api::core::v1::{ConfigMap, Service};
use k8s_openapi::api::networking::v1::NetworkPolicy;
use k8s_openapi::api::policy::v1::PodDisruptionBudget;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::collections::BTreeSet;

pub(crate) const FOLDERS: [&str; 3] = ["base", "trial", "wall"];

fn objects(folder: &str) -> Vec<Value> {
    build(&crate::deploy().join("kubernetes").join(folder))
}

#[test]
fn manifests_are_what_kubernetes_reads() {
    for folder in FOLDERS {
        let objects = objects(folder);
        for object in &objects {
            let read = match (object["apiVersion"].as_str().unwrap(), object["kind"].as_str().unwrap()) {
                ("v1", "ConfigMap") => read_back::<ConfigMap>(object),
                ("v1", "Service") => read_back::<Service>(object),
                ("apps/v1", "Deployment") => read_back::<Deployment>(object),
                ("apps/v1", "StatefulSet") => read_back::<StatefulSet>(object),
                ("policy/v1", "PodDisruptionBudget") => read_back::<PodDisruptionBudget>(object),
                ("networking.k8s.io/v1", "NetworkPolicy") => read_back::<NetworkPolicy>(object),
                other => Err(format!("{other:?} isn't known to this test")),
            };
            let name = &object["metadata"]["name"];
            read.unwrap_or_else(|what| panic!("{folder}, {} {name}: {what}", object["kind"]));
        }
        println!("{folder}: {} objects", objects.len());
    }
}

fn read_back<T: DeserializeOwned + Serialize>(object: &Value) -> Result<(), String> {
    let read: T = serde_json::from_value(object.clone()).map_err(|error| error.to_string())?;
    lost(object, &serde_json::to_value(read).unwrap(), "")
}

/// What is in the first and not, or otherwise, in the second.
fn lost(written: &Value, read: &Value, path: &str) -> Result<(), String> {
    match (written, read) {
        (Value::Object(written), Value::Object(read)) => written.iter().try_for_each(|(key, value)| {
            let at = format!("{path}/{key}");
            match read.get(key) {
                Some(read) => lost(value, read, &at),
                // What is empty may be left out.
                None if value.as_object().is_some_and(serde_json::Map::is_empty) => Ok(()),
                None if value.as_array().is_some_and(Vec::is_empty) => Ok(()),
                None => Err(format!("{at} is unknown")),
            }
        }),
        (Value::Array(written), Value::Array(read)) if written.len() == read.len() => written
            .iter()
            .zip(read)
            .enumerate()
            .try_for_each(|(k, (written, read))| lost(written, read, &format!("{path}/{k}"))),
        (written, read) if written == read => Ok(()),
        (written, read) => Err(format!("{path} is {written}, and read as {read}")),
    }
}

#[test]
fn a_misspelt_key_is_found() {
    let mut service = objects("base").into_iter().find(|object| object["kind"] == "Service").unwrap();
    read_back::<Service>(&service).unwrap();
    service["spec"]["selectors"] = service["spec"]["selector"].clone();
    assert_eq!(read_back::<Service>(&service), Err("/spec/selectors is unknown".into()));
}

/// A pod's labels and its containers' ports, by what makes it.
struct Pods {
    labels: Value,
    ports: Vec<Value>,
}

fn pods(objects: &[Value]) -> Vec<Pods> {
    let makers = objects.iter().filter(|object| object["spec"].get("template").is_some());
    let pods = |maker: &Value| {
        let template = &maker["spec"]["template"];
        let containers = template["spec"]["containers"].as_array().unwrap().iter();
        let ports = containers.flat_map(|container| container["ports"].as_array().cloned().unwrap_or_default());
        Pods { labels: template["metadata"]["labels"].clone(), ports: ports.collect() }
    };
    makers.map(pods).collect()
}

fn matching<'a>(pods: &'a [Pods], labels: &Value) -> Vec<&'a Pods> {
    let labels = labels.as_object().unwrap();
    let wears = |pods: &&Pods| labels.iter().all(|(key, value)| pods.labels.get(key) == Some(value));
    pods.iter().filter(wears).collect()
}

#[test]
fn what_is_referred_to_is_there() {
    for folder in FOLDERS {
        let objects = objects(folder);
        let pods = pods(&objects);
        for object in &objects {
            let (kind, name, spec) = (object["kind"].as_str().unwrap(), &object["metadata"]["name"], &object["spec"]);
            let place = format!("{folder}, {kind} {name}");
            match kind {
                "Deployment" | "StatefulSet" => {
                    assert_eq!(
                        matching(&pods, &spec["selector"]["matchLabels"]).len(),
                        1,
                        "{place} selects its own pods"
                    );
                    check_pod(&place, &spec["template"]["spec"], &objects);
                }
                "Service" => {
                    let found = matching(&pods, &spec["selector"]);
                    assert_eq!(found.len(), 1, "{place} has pods of one kind");
                    for port in spec["ports"].as_array().unwrap() {
                        let is_there = |known: &&Value| {
                            known["name"] == port["targetPort"] && known["protocol"] == port["protocol"]
                        };
                        let target = found[0].ports.iter().find(is_there).unwrap_or_else(|| panic!("{place}: {port}"));
                        assert_eq!(target["containerPort"], port["port"], "{place} has the pods' own numbers");
                    }
                }
                "PodDisruptionBudget" => {
                    assert_eq!(matching(&pods, &spec["selector"]["matchLabels"]).len(), 1, "{place}");
                }
                "NetworkPolicy" => check_policy(&place, spec, &pods),
                _ => {}
            }
        }
    }
}

/// The strictest settings, no more than what is needed, and volumes and probes that exist.
fn check_pod(place: &str, spec: &Value, objects: &[Value]) {
    assert_eq!(spec["securityContext"]["runAsNonRoot"], true, "{place}");
    assert_eq!(spec["automountServiceAccountToken"], false, "{place} has no business with Kubernetes itself");
    assert!(spec["terminationGracePeriodSeconds"].as_u64() >= Some(2), "{place}: a leave takes up to 0.7 s");
    let volumes: BTreeSet<_> =
        spec["volumes"].as_array().into_iter().flatten().map(|volume| &volume["name"]).map(name).collect();
    for volume in spec["volumes"].as_array().into_iter().flatten() {
        if let Some(wanted) = volume.pointer("/configMap/name") {
            let is_it = |object: &Value| object["kind"] == "ConfigMap" && object["metadata"]["name"] == *wanted;
            assert!(objects.iter().any(is_it), "{place}: no {wanted}");
        }
    }
    for container in spec["containers"].as_array().unwrap() {
        let security = &container["securityContext"];
        assert_eq!(security["readOnlyRootFilesystem"], true, "{place}");
        assert_eq!(security["allowPrivilegeEscalation"], false, "{place}");
        assert_eq!(security["capabilities"]["drop"][0], "ALL", "{place}");
        assert!(container.pointer("/resources/requests/cpu").is_some(), "{place} says what it needs");
        // By default an image without a version is asked of a registry, though it has been loaded into the node.
        assert_eq!(container["imagePullPolicy"], "IfNotPresent", "{place}");
        for mount in container["volumeMounts"].as_array().into_iter().flatten() {
            assert!(volumes.contains(&name(&mount["name"])), "{place}: no volume {}", mount["name"]);
        }
        for probe in ["startupProbe", "livenessProbe", "readinessProbe"] {
            let Some(port) = container[probe].pointer("/httpGet/port") else { continue };
            let known = container["ports"].as_array().unwrap().iter().any(|known| known["name"] == *port);
            assert!(known, "{place}: {probe} asks at {port}");
        }
    }
}

fn name(value: &Value) -> String {
    value.as_str().unwrap().to_owned()
}

/// Both ends of what is allowed are pods of the rig, and ports are theirs.
fn check_policy(place: &str, spec: &Value, pods: &[Pods]) {
    let own = matching(pods, &spec["podSelector"]["matchLabels"]);
    assert_eq!(own.len(), 1, "{place}");
    let has = |pods: &Pods, port: &Value| {
        pods.ports.iter().any(|known| known["containerPort"] == port["port"] && known["protocol"] == port["protocol"])
    };
    for rule in spec["ingress"].as_array().into_iter().flatten() {
        for port in rule["ports"].as_array().unwrap() {
            assert!(has(own[0], port), "{place}: {port} isn't listened at");
        }
    }
    for rule in spec["egress"].as_array().into_iter().flatten() {
        let peers = rule["to"].as_array().into_iter().flatten().map(|peer| &peer["podSelector"]["matchLabels"]);
        for peer in peers {
            let found = matching(pods, peer);
            assert_eq!(found.len(), 1, "{place}: {peer}");
            for port in rule["ports"].as_array().unwrap() {
                assert!(has(found[0], port), "{place}: {port} of {peer} isn't listened at");
            }
        }
    }
}
