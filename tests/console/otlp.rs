//! Traces as a collector gets them. The test is the collector.

use crate::program::{HANG, Rig, cyclorama, wait_for};
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, Sender, channel};

/// Takes requests until the test is over, and hands on their bodies.
fn collector() -> (String, Receiver<(String, Value)>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let (sender, requests) = channel();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let sender = sender.clone();
            std::thread::spawn(move || serve(stream.unwrap(), &sender));
        }
    });
    (url, requests)
}

fn serve(mut stream: TcpStream, requests: &Sender<(String, Value)>) -> Option<()> {
    let mut reader = BufReader::new(stream.try_clone().unwrap());
    loop {
        let (mut head, mut length) = (String::new(), 0);
        loop {
            let mut line = String::new();
            if reader.read_line(&mut line).ok()? == 0 {
                return None;
            }
            if let Some(value) = line.to_lowercase().strip_prefix("content-length:") {
                length = value.trim().parse().unwrap();
            }
            if line == "\r\n" {
                break;
            }
            head += &line;
        }
        let mut body = vec![0; length];
        reader.read_exact(&mut body).ok()?;
        write!(stream, "HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: 2\r\n\r\n{{}}").ok()?;
        requests.send((head, serde_json::from_slice(&body).unwrap())).ok()?;
    }
}

#[test]
fn a_collector_gets_every_frame_as_a_trace() {
    let (url, requests) = collector();
    let rig = Rig::start(&["--views", "1", "--boards", "2", "--size", "96x64", "--samples", "1", "--otlp", &url]);
    rig.wait("flight", |stats| stats["frames"].as_u64() > Some(30));
    let mut traces: BTreeMap<String, Vec<Value>> = BTreeMap::new();
    wait_for("sixty frames", || {
        let (head, body) = requests.recv_timeout(HANG).expect("frames are sent");
        assert!(
            head.starts_with("POST /v1/traces HTTP/1.1") && head.to_lowercase().contains("application/json"),
            "{head}"
        );
        for resource in body["resourceSpans"].as_array().unwrap() {
            let service = resource["resource"]["attributes"]
                .as_array()
                .unwrap()
                .iter()
                .find(|a| a["key"] == "service.name")
                .unwrap();
            assert_eq!(service["value"]["stringValue"], "cyclorama");
            for span in
                resource["scopeSpans"].as_array().unwrap().iter().flat_map(|scope| scope["spans"].as_array().unwrap())
            {
                traces.entry(span["traceId"].as_str().unwrap().to_owned()).or_default().push(span.clone());
            }
        }
        (traces.len() >= 60).then_some(())
    });
    let time = |span: &Value, name: &str| span[name].as_str().unwrap().parse::<u64>().unwrap();
    let mut frames = Vec::new();
    for spans in traces.values() {
        let roots: Vec<_> =
            spans.iter().filter(|span| span["parentSpanId"].as_str().unwrap_or_default().is_empty()).collect();
        assert_eq!((roots.len(), &roots[0]["name"]), (1, &Value::from("frame")));
        frames.push(roots[0]["attributes"][0]["value"]["intValue"].as_str().unwrap().parse::<u64>().unwrap());
        for span in spans {
            let parent = spans.iter().find(|other| other["spanId"] == span["parentSpanId"]);
            let Some(parent) = parent else { continue };
            assert!(time(span, "startTimeUnixNano") >= time(parent, "startTimeUnixNano"), "{span} in {parent}");
            assert!(time(span, "endTimeUnixNano") <= time(parent, "endTimeUnixNano"), "{span} in {parent}");
        }
    }
    frames.sort_unstable();
    assert!(frames.windows(2).all(|pair| pair[1] > pair[0]), "no frame twice: {frames:?}");
    let named = |name: &str| traces.values().filter(|spans| spans.iter().any(|span| span["name"] == name)).count();
    for name in ["open to swap", "draw", "raster", "stitch"] {
        assert!(named(name) > 30, "{name} in {} of {} frames", named(name), traces.len());
    }
}

#[test]
fn an_address_that_is_none_is_refused() {
    let output = cyclorama().args(["manager", "--otlp", "collector:4318", "--console", "off"]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains("http://collector:4318"), "{said}");
}
