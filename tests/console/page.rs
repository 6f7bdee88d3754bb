//! The page in a real browser: what it shows is what the rig does, and everybody can use it.

use crate::access::request;
use crate::browser::Page;
use crate::program::{Daemon, Rig, daemon, get, kill, manager, wait_for};
use serde_json::{Value, json};
use std::time::Instant;

const SMALL: [&str; 8] = ["--views", "2", "--boards", "3", "--size", "160x90", "--samples", "1"];
const DESK: (u32, u32) = (1600, 1000);
const PHONE: (u32, u32) = (390, 844);

/// The pixels of the picture as one number.
const PICTURE: &str = "(() => { const c = document.getElementById('picture'), copy = new OffscreenCanvas(c.width, c.height); \
                       const g = copy.getContext('2d', { willReadFrequently: true }); g.drawImage(c, 0, 0); \
                       const p = g.getImageData(0, 0, c.width, c.height).data; let h = 0; for (let i = 0; i < p.length; i += 7) h = (h * 31 + p[i]) | 0; return h; })()";

fn url(rig: &Rig) -> String {
    format!("http://{}/", rig.console())
}

/// A rig in flight, and its console in a browser.
fn open(args: &[&str], size: (u32, u32)) -> Option<(Rig, Page)> {
    let rig = Rig::start(args);
    rig.wait("flight", |stats| stats["frames"].as_u64() > Some(10));
    let page = Page::open(&url(&rig), size)?;
    Some((rig, page))
}

/// The card of the board of that name, as an expression.
fn card(name: &str) -> String {
    format!(
        "[...document.querySelectorAll('#boards li')].find(li => li.querySelector('.name').textContent === '{name}')"
    )
}

fn word(page: &mut Page, name: &str) -> String {
    page.value(&format!("{}?.querySelector('.word').textContent ?? ''", card(name))).as_str().unwrap().to_owned()
}

/// The process of the board of that name.
fn board(rig: &Rig, name: &str) -> u32 {
    let is_it = |pid: &u32| {
        let command = std::fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        command.contains(&format!("\0--name\0{name}\0"))
    };
    rig.children(&["channel"]).into_iter().find(is_it).expect("the board's process is there")
}

/// Starts a board of that name beside those of a rig.
fn another_board(rig: &Rig, name: &str) -> Daemon {
    let compositor = rig.children(&["compositor"])[0];
    let command = std::fs::read_to_string(format!("/proc/{compositor}/cmdline")).unwrap();
    let backplane = command.split('\0').skip_while(|word| *word != "--backplane").nth(1).unwrap().to_owned();
    daemon(&["channel", "--backplane", &backplane, "--name", name, "--threads", "1"])
}

#[test]
fn the_picture_moves_and_the_figures_are_the_rigs() {
    let Some((rig, mut page)) = open(&SMALL, DESK) else { return };
    page.wait("a picture", "document.getElementById('picture-rate').textContent.startsWith('frame')");
    let first = page.value(PICTURE);
    wait_for("another picture", || (page.value(PICTURE) != first).then_some(()));
    assert_eq!(page.value("document.getElementById('picture').width"), 320, "two views of 160");
    page.click("#views button:nth-child(3)");
    page.wait("one view", "document.getElementById('picture').width === 160");
    assert_eq!(page.value("document.querySelectorAll('#boards li').length"), 3);
    page.wait(
        "all boards drawing",
        "[...document.querySelectorAll('#boards .word')].every(word => word.textContent === 'DRAWING')",
    );
    let shares = "[...document.querySelectorAll('#boards li')].reduce((sum, li) => sum + Number(li.querySelector('dl span').textContent), 0)";
    let all = page.value(shares).as_f64().unwrap();
    assert!((all - 100.0).abs() < 0.3, "the boards' shares are the whole picture: {all} %");
    page.wait("running", "document.getElementById('doing').textContent === 'RUNNING'");
    page.wait(
        "figures",
        "['f-rate', 'f-frame', 'f-latency'].every(id => Number(document.getElementById(id).textContent) > 0)",
    );
    let frame: u64 = page.text("frame").replace(',', "").parse().unwrap();
    let now = rig.stats().unwrap()["frames"].as_u64().unwrap();
    assert!(frame > 0 && frame <= now + 1, "frame {frame} of {now}");
    page.wait("a chart", "document.getElementById('chart').width > 100");
    assert!(page.text("stages").contains("raster") && page.text("skipped").contains("triangles from behind"));
    assert_eq!(page.errors(), Vec::<String>::new(), "the browser has nothing to complain about");
}

#[test]
fn a_killed_board_turns_red_and_returns() {
    let Some((rig, mut page)) = open(&SMALL, DESK) else { return };
    wait_for("board 1 drawing", || (word(&mut page, "1") == "DRAWING").then_some(()));
    let killed = Instant::now();
    kill(board(&rig, "1"));
    wait_for("the card", || (word(&mut page, "1") == "LOST").then_some(()));
    println!("a killed board is shown as lost after {:?}", killed.elapsed());
    let red = page.value(&format!("getComputedStyle({}).borderLeftColor", card("1")));
    assert_eq!(red, "rgb(255, 98, 87)");
    page.wait("it is said aloud", "document.getElementById('announce').textContent.startsWith('Board 1: lost')");
    let _board = another_board(&rig, "1");
    wait_for("its return", || (word(&mut page, "1") == "DRAWING").then_some(()));
    assert_eq!(page.value("document.querySelectorAll('#boards li').length"), 3, "in its old place");
    assert_eq!(page.errors(), Vec::<String>::new());
}

#[test]
fn pause_step_and_resume_hold_and_move_the_picture() {
    let Some((rig, mut page)) = open(&SMALL, DESK) else { return };
    page.wait("controls", "!document.getElementById('pause').disabled");
    page.click("#pause");
    page.wait("paused", "document.getElementById('doing').textContent === 'PAUSED'");
    let frames = |rig: &Rig| rig.stats().unwrap()["frames"].as_u64().unwrap();
    // One more frame may be under way.
    let held = wait_for("two looks that agree", || {
        let before = frames(&rig);
        std::thread::sleep(std::time::Duration::from_millis(400));
        (frames(&rig) == before).then_some(before)
    });
    page.wait(
        "the held frame's picture",
        &format!("document.getElementById('picture-rate').textContent.startsWith('frame {}')", thousands(held - 1)),
    );
    let still = page.value(PICTURE);
    assert!(rig.get("/ready").unwrap().0.starts_with("HTTP/1.1 200"), "a paused rig is in hand");
    for step in 1..=3 {
        page.click("#step");
        wait_for("the step", || (frames(&rig) == held + step).then_some(()));
    }
    page.wait(
        "its picture",
        &format!("document.getElementById('picture-rate').textContent.startsWith('frame {}')", thousands(held + 2)),
    );
    assert_ne!(page.value(PICTURE), still, "the flight went on meanwhile");
    assert_eq!(frames(&rig), held + 3, "three frames and no more");
    page.click("#pause");
    rig.wait("going on", |stats| stats["frames"].as_u64() > Some(held + 20));
    assert_eq!(page.text("pause"), "Pause");
    let log = rig.stats().unwrap()["events"].to_string();
    assert!(log.contains("paused after the next frame (console, 127.0.0.1)") && log.contains("goes on"), "{log}");
    assert_eq!(page.errors(), Vec::<String>::new());
}

fn thousands(number: u64) -> String {
    let digits = number.to_string();
    let groups: Vec<&str> =
        digits.as_bytes().rchunks(3).rev().map(|group| std::str::from_utf8(group).unwrap()).collect();
    groups.join(",")
}

#[test]
fn a_board_is_taken_out_without_a_late_frame_and_put_back() {
    let Some((rig, mut page)) = open(&SMALL, DESK) else { return };
    wait_for("board 2 drawing", || (word(&mut page, "2") == "DRAWING").then_some(()));
    page.value(&format!("{}.querySelector('button').id = 'out'", card("2")));
    page.click("#out");
    page.wait("a question", "document.getElementById('confirm').open");
    page.press("Escape");
    page.wait("no answer", "!document.getElementById('confirm').open");
    assert_eq!(word(&mut page, "2"), "DRAWING", "nothing was done");
    page.click("#out");
    page.wait("the question again", "document.getElementById('confirm').open");
    page.click("#confirm button[value=yes]");
    wait_for("it is out", || (word(&mut page, "2") == "TAKEN OUT").then_some(()));
    let stats = rig.wait("two boards", |stats| stats["boards"] == 2);
    assert!(!stats["events"].to_string().contains("\"lost\""), "{stats}");
    let process = board(&rig, "2");
    let flown = stats["frames"].as_u64().unwrap();
    rig.wait("flight without it", |stats| stats["frames"].as_u64() > Some(flown + 20));
    page.click("#out");
    wait_for("it is back", || (word(&mut page, "2") == "DRAWING").then_some(()));
    let stats = rig.wait("three boards", |stats| stats["boards"] == 3);
    assert_eq!(stats["dropped"]["boards"], 0, "nobody was put out: {stats}");
    assert_eq!(board(&rig, "2"), process, "it has been the same all the time");
    assert_eq!(page.errors(), Vec::<String>::new());
}

#[test]
fn mode_and_samples_change_while_the_rig_runs() {
    let Some((rig, mut page)) = open(&SMALL, DESK) else { return };
    page.wait("controls", "!document.getElementById('mode').disabled");
    let choose = |page: &mut Page, id: &str, value: &str| {
        page.value(&format!("{{ const s = document.getElementById('{id}'); s.value = '{value}'; s.dispatchEvent(new Event('change', {{bubbles: true}})); }}"));
    };
    choose(&mut page, "mode", "region");
    choose(&mut page, "samples", "16");
    page.click("#apply");
    let views = |rig: &Rig| live(rig)["views"].clone();
    wait_for("both", || {
        views(&rig).as_array().unwrap().iter().all(|v| v["mode"] == "region" && v["samples"] == "16").then_some(())
    });
    page.wait(
        "the form to agree",
        "document.getElementById('apply').disabled && document.getElementById('mode').value === 'region'",
    );
    let flown = rig.stats().unwrap()["frames"].as_u64().unwrap();
    let stats = rig.wait("flight", |stats| stats["frames"].as_u64() > Some(flown + 20));
    assert_eq!((&stats["boards"], &stats["dropped"]["boards"]), (&json!(3), &json!(0)));
    // Tiles by owner are those of regions: neighbours have the same owner.
    page.click("#owners");
    page.wait(
        "colours",
        "document.querySelectorAll('#legend li').length === 3 && !document.getElementById('legend').hidden",
    );
    let owners: Value = serde_json::from_slice(&rig.get("/api/v1/owners").unwrap().1).unwrap();
    assert_eq!((&owners["boards"], &owners["views"][0]["mode"]), (&json!(3), &json!("region")));
    assert_eq!(page.errors(), Vec::<String>::new());
}

fn live(rig: &Rig) -> Value {
    serde_json::from_slice(&rig.get("/api/v1/live").unwrap().1).unwrap()
}

#[test]
fn tiles_by_owner_tint_the_picture() {
    let Some((_rig, mut page)) = open(&SMALL, DESK) else { return };
    page.wait("controls", "!document.getElementById('pause').disabled");
    page.click("#pause");
    page.wait("paused", "document.getElementById('doing').textContent === 'PAUSED'");
    let plain = wait_for("a still picture", || {
        let now = page.value(PICTURE);
        std::thread::sleep(std::time::Duration::from_millis(300));
        (page.value(PICTURE) == now).then_some(now)
    });
    page.click("#owners");
    wait_for("a tint", || (page.value(PICTURE) != plain).then_some(()));
    page.click("#owners");
    wait_for("none", || (page.value(PICTURE) == plain).then_some(()));
    assert_eq!(page.errors(), Vec::<String>::new());
}

/// The pixels of the picture that have a colour of the legend shown, of all; a JPEG's colours are off by a little.
const LIKE_LEGEND: &str = "(() => { const c = document.getElementById('picture'), copy = new OffscreenCanvas(c.width, c.height), g = copy.getContext('2d'); \
    g.drawImage(c, 0, 0); const p = g.getImageData(0, 0, c.width, c.height).data; \
    const known = [...document.querySelectorAll('#debug-legend i')].map(i => getComputedStyle(i).backgroundColor.match(/\\d+/g).map(Number)); let n = 0; \
    for (let i = 0; i < p.length; i += 4) if (known.some(k => Math.hypot(k[0] - p[i], k[1] - p[i + 1], k[2] - p[i + 2]) < 30)) n++; return 4 * n / p.length; })()";

#[test]
fn debug_pictures_are_drawn_by_the_boards_and_go_with_one_press() {
    let args = ["--views", "1", "--boards", "2", "--size", "320x180", "--samples", "1"];
    let Some((rig, mut page)) = open(&args, DESK) else { return };
    page.wait("controls", "!document.querySelector('#debugs button').disabled");
    page.click("#pause");
    page.wait("paused", "document.getElementById('doing').textContent === 'PAUSED'");
    let still = |page: &mut Page| {
        wait_for("a still picture", || {
            let now = page.value(PICTURE);
            std::thread::sleep(std::time::Duration::from_millis(300));
            (page.value(PICTURE) == now).then_some(now)
        })
    };
    let plain = still(&mut page);
    let legend = "[...document.querySelectorAll('#debug-legend li')].map(li => li.textContent).join('|')";
    for (picture, means) in [("depth", "17 to 32"), ("levels", "level 0, the finest"), ("skips", "not sent again")] {
        page.click(&format!("#debugs [data-picture={picture}]"));
        page.wait(
            "the legend",
            &format!("{legend}.includes('{means}') && !document.getElementById('debug-legend').hidden"),
        );
        page.wait("it is said", "document.getElementById('debug-note').textContent.includes('displays show it too')");
        wait_for("another picture", || (page.value(PICTURE) != plain).then_some(()));
        let shown = still(&mut page);
        assert_ne!(shown, plain, "{picture}");
        if picture != "levels" {
            // Of the legend's colours and no others, but for where they meet.
            let share = wait_for("its colours", || page.value(LIKE_LEGEND).as_f64().filter(|share| *share > 0.5));
            println!("{picture}: {share:.2} of the pixels have colours of the legend");
        }
        assert_eq!(live(&rig)["debug"]["picture"], picture);
    }
    let (_, metrics) = rig.get("/metrics").unwrap();
    assert!(String::from_utf8_lossy(&metrics).contains("cyclorama_debug_picture 1"));
    page.click("#debugs [data-picture=off]");
    page.wait(
        "no legend",
        "document.getElementById('debug-legend').hidden && !document.getElementById('debug-note').textContent",
    );
    assert_eq!(live(&rig)["debug"]["picture"], "off");
    page.click("#pause");
    rig.wait("flight", |stats| stats["dropped"]["boards"] == 0);
    let log = rig.stats().unwrap()["events"].to_string();
    assert!(
        log.contains("debug picture skips from the next frame on, on the displays too (console, 127.0.0.1)"),
        "{log}"
    );
    assert_eq!(page.errors(), Vec::<String>::new());
}

/// Two managers, of which the second stands by for the first: backplane and console of each.
fn two_managers() -> [(Daemon, [std::net::SocketAddr; 3]); 2] {
    let scene = ["--scene", "runway", "--views", "1", "--size", "96x64", "--samples", "1"];
    let ports = ["--listen", "127.0.0.1:0", "--pose-listen", "127.0.0.1:0", "--console", "127.0.0.1:0"];
    let first = manager(&[&scene[..], &ports].concat());
    let leader = first.1[0].to_string();
    let second = manager(&[&scene[..], &ports, &["--standby", &leader]].concat());
    [first, second]
}

#[test]
fn consoles_say_who_leads_and_who_stands_by() {
    let [(_first, [backplane, _, leads]), (second, [_, _, stands])] = two_managers();
    // It takes a term when a frame has been shown.
    let _board = daemon(&["channel", "--backplane", &backplane.to_string(), "--threads", "1"]);
    let lead = |console| -> Option<Value> {
        serde_json::from_slice::<Value>(&get(console, "/api/v1/live")?.1).ok().map(|live| live["lead"].clone())
    };
    let said = wait_for("a stand-by", || lead(leads).filter(|lead| !lead["other"].is_null()));
    assert_eq!((&said["leads"], &said["of"], &said["other"]), (&json!(true), &Value::Null, &json!("127.0.0.1")));
    let said = wait_for("a leader", || lead(stands).filter(|lead| lead["term"] != 0));
    assert_eq!(said["leads"], false);
    assert!(said["of"].as_str().unwrap().starts_with("127.0.0.1:"), "{said}");
    let metric = |console, line: &str| {
        wait_for(line, || String::from_utf8_lossy(&get(console, "/metrics")?.1).contains(line).then_some(()));
    };
    metric(leads, "\ncyclorama_leads 1");
    metric(leads, "\ncyclorama_standby 1");
    metric(stands, "\ncyclorama_leads 0");
    let (head, why) = get(stands, "/ready").unwrap();
    assert!(head.starts_with("HTTP/1.1 503") && String::from_utf8_lossy(&why).contains("stands by for 127.0.0.1:"));
    let headers = [("Content-Type", "application/json")];
    let (status, why) =
        request(stands, "POST", "/api/v1/control", &headers, r#"{"do": "debug", "picture": "depth"}"#).unwrap();
    assert!(status == 409 && why.contains("which leads: use the console there"), "{status} {why}");

    let Some(mut page) = Page::open(&format!("http://{stands}/"), PHONE) else { return };
    page.wait("its part", "document.getElementById('doing').textContent === 'STANDS BY'");
    page.wait("for whom", "document.getElementById('lead').textContent.startsWith('stands by for 127.0.0.1:')");
    assert_eq!(
        page.value(
            "[...document.querySelectorAll('.controls .pair button, #apply, #debugs button')].every(b => b.disabled)"
        ),
        true
    );
    let widths = page.value("[document.documentElement.scrollWidth, innerWidth]");
    assert_eq!(widths, json!([PHONE.0, PHONE.0]));
    drop(page);
    let Some(mut page) = Page::open(&format!("http://{leads}/"), DESK) else { return };
    page.wait(
        "its term",
        "/^leads, term [0-9,]+; stand-by at 127.0.0.1 for /.test(document.getElementById('lead').textContent)",
    );
    drop(second);
    page.wait("it is gone", "document.getElementById('lead').textContent.endsWith('; no stand-by')");
    assert_eq!(page.errors(), Vec::<String>::new());
}

#[test]
fn nothing_overflows_on_a_phone_or_a_desk() {
    let Some((_rig, mut page)) = open(&SMALL, PHONE) else { return };
    page.wait("boards", "document.querySelectorAll('#boards li').length === 3");
    for (width, height) in [PHONE, (320, 700), (768, 1024), (1280, 800), (1920, 1080), (3840, 2160)] {
        page.resize((width, height));
        let over = page.value(&"[...document.querySelectorAll('body *')].filter(e => !e.closest('.unseen') && !e.closest('.skip') && e.getClientRects().length \
             && (e.getBoundingClientRect().right > WIDTH + 1 || e.getBoundingClientRect().left < -1)).map(e => e.tagName + '#' + e.id + '.' + e.className)".replace("WIDTH", &width.to_string()));
        assert_eq!(over, json!([]), "at {width} pixels");
        let widths = page.value("[document.documentElement.scrollWidth, innerWidth]");
        assert_eq!(widths, json!([width, width]), "at {width} pixels");
    }
    assert_eq!(page.errors(), Vec::<String>::new());
}

#[test]
fn nothing_jumps_while_numbers_change() {
    let Some((_rig, mut page)) = open(&SMALL, DESK) else { return };
    page.wait(
        "boards",
        "[...document.querySelectorAll('#boards .word')].filter(word => word.textContent === 'DRAWING').length === 3",
    );
    page.wait("figures", "Number(document.getElementById('f-latency').textContent) > 0");
    page.wait("a picture", "document.getElementById('picture-rate').textContent.startsWith('frame')");
    let places = "JSON.stringify([...document.querySelectorAll('.panel, #boards li, #figures dl > div, #picture, #pause')].map(e => { const r = e.getBoundingClientRect(); \
                  return [r.x, r.y, r.width, r.height].map(Math.round); }))";
    let first = page.value(places);
    let frame = page.text("frame");
    wait_for("frames", || (page.text("frame") != frame).then_some(()));
    for _ in 0..10 {
        std::thread::sleep(std::time::Duration::from_millis(250));
        assert_eq!(page.value(places), first);
    }
}

#[test]
fn the_keyboard_reaches_everything_and_everything_has_a_name() {
    let Some((_rig, mut page)) = open(&SMALL, DESK) else { return };
    page.wait("boards", "document.querySelectorAll('#boards li').length === 3");
    page.wait("controls", "!document.getElementById('pause').disabled");
    // The step button is for a paused rig.
    page.value("document.getElementById('pause').focus()");
    page.press("Enter");
    page.wait("paused by the keyboard", "document.getElementById('doing').textContent === 'PAUSED'");
    page.wait("step", "!document.getElementById('step').disabled");
    let name = "(e => e.id || e.getAttribute('aria-label') || e.textContent)";
    let wanted = page.value(&format!(
        "[...document.querySelectorAll('a, button, select, input, [tabindex=\"0\"]')].filter(e => !e.disabled && e.getClientRects().length).map({name})"
    ));
    page.value("document.activeElement.blur(); window.getSelection().removeAllRanges(); document.body.focus()");
    let mut reached = Vec::new();
    for _ in 0..60 {
        page.press("Tab");
        let here =
            page.value(&format!("document.activeElement === document.body ? null : {name}(document.activeElement)"));
        let seen =
            page.value("document.activeElement === document.body || document.activeElement.matches(':focus-visible')");
        assert_eq!(seen, true, "{here} shows that it has the focus");
        if !here.is_null() && !reached.contains(&here) {
            reached.push(here);
        }
    }
    for element in wanted.as_array().unwrap() {
        assert!(reached.contains(element), "{element} is not reached by Tab: {reached:?}");
    }
    let tree = page.call("Accessibility.getFullAXTree", &json!({}));
    let mut named = 0;
    for node in tree["nodes"].as_array().unwrap().iter().filter(|node| node["ignored"] == false) {
        let role = node["role"]["value"].as_str().unwrap_or_default();
        let has_name = [
            "button",
            "checkbox",
            "combobox",
            "textbox",
            "image",
            "img",
            "link",
            "heading",
            "log",
            "region",
            "columnheader",
            "rowheader",
        ];
        if has_name.contains(&role) {
            let name = node["name"]["value"].as_str().unwrap_or_default();
            assert!(!name.trim().is_empty(), "a {role} without a name: {node}");
            named += 1;
        }
    }
    assert!(named > 30, "{named} elements with names");
    assert_eq!(page.value("document.documentElement.lang"), "en");
}

#[test]
fn a_locked_console_opens_by_its_token() {
    let rig = Rig::start(&[&SMALL[..], &["--console-token", "open sesame 123"]].concat());
    rig.wait("flight", |stats| stats["frames"].as_u64() > Some(10));
    let Some(mut page) = Page::open(&url(&rig), DESK) else { return };
    page.wait(
        "a locked console",
        "!document.getElementById('unlock').hidden && document.getElementById('pause').disabled",
    );
    let give = |page: &mut Page, token: &str| {
        page.value(&format!("document.getElementById('token').value = '{token}'"));
        page.click("#unlock button");
    };
    give(&mut page, "wrong wrong wrong");
    page.wait("the button", "!document.getElementById('pause').disabled");
    page.click("#pause");
    page.wait("a refusal", "document.getElementById('said').textContent.includes(\"Give the console's token\")");
    page.wait("locked again", "!document.getElementById('unlock').hidden && document.getElementById('pause').disabled");
    // What the browser logs of a refused request is no fault of the page.
    page.errors();
    give(&mut page, "open sesame 123");
    page.wait("the button", "!document.getElementById('pause').disabled");
    page.click("#pause");
    page.wait("paused", "document.getElementById('doing').textContent === 'PAUSED'");
    assert_eq!(page.errors(), Vec::<String>::new());
}

#[test]
fn pictures_for_the_docs() {
    let Some(folder) = std::env::var_os("CYCLORAMA_SCREENSHOTS") else { return };
    // Tests run in their package's folder.
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(folder);
    let args = ["--views", "3", "--boards", "5", "--size", "480x270", "--samples", "4", "--rate", "10"];
    let Some((rig, mut page)) = open(&args, (1160, 1440)) else { return };
    rig.wait("a while of flight", |stats| stats["seconds"].as_f64() > Some(70.0));
    kill(board(&rig, "3"));
    wait_for("the card", || (word(&mut page, "3") == "LOST").then_some(()));
    page.wait("a picture", "document.getElementById('picture-rate').textContent.startsWith('frame')");
    std::thread::sleep(std::time::Duration::from_secs(2));
    let mut shoot = |name: &str, size, format: &Value| {
        page.resize(size);
        std::thread::sleep(std::time::Duration::from_secs(2));
        let shot = page.call("Page.captureScreenshot", format);
        std::fs::write(folder.join(name), base64(shot["data"].as_str().unwrap())).unwrap();
    };
    shoot("console.png", (1160, 1440), &json!({"format": "png"}));
    shoot("console-phone.png", PHONE, &json!({"format": "png"}));
    for name in ["console.png", "console-phone.png"] {
        assert!(std::fs::metadata(folder.join(name)).unwrap().len() < 400_000, "{name} is for a page of text");
    }
}

#[test]
fn debug_pictures_for_the_docs() {
    let Some(folder) = std::env::var_os("CYCLORAMA_SCREENSHOTS") else { return };
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(folder);
    let scenes = tempfile::tempdir().unwrap();
    let towers = crate::towers::write(scenes.path()).map(|path| path.to_str().unwrap().to_owned());
    let towers = [towers[0].as_str(), "--camera", &towers[1]];
    // Slowly: a picture of a tile that wasn't sent again needs frames that are alike.
    let rig = ["--views", "1", "--boards", "2", "--size", "640x360", "--samples", "4", "--rate", "5"];
    for (picture, scene) in [("depth", &["airport"][..]), ("levels", &towers[..]), ("skips", &["airport"][..])] {
        let Some((rig, mut page)) = open(&[scene, &rig].concat(), (1160, 900)) else { return };
        page.wait("controls", "!document.querySelector('#debugs button').disabled");
        rig.wait("a while of flight", |stats| stats["seconds"].as_f64() > Some(6.0));
        page.click(&format!("#debugs [data-picture={picture}]"));
        page.wait("its legend", "!document.getElementById('debug-legend').hidden");
        std::thread::sleep(std::time::Duration::from_secs(3));
        let place = page.value(
            "(() => { const e = document.getElementById('look'); e.scrollIntoView(); const r = e.getBoundingClientRect(); \
             return [r.x, r.y + scrollY, r.width, r.height]; })()",
        );
        let clip = json!({"x": place[0], "y": place[1], "width": place[2], "height": place[3], "scale": 1});
        let shot = json!({"format": "png", "clip": clip, "captureBeyondViewport": true});
        let shot = page.call("Page.captureScreenshot", &shot);
        let png = base64(shot["data"].as_str().unwrap());
        assert!(png.len() < 400_000, "{} bytes are too many for a page of text", png.len());
        std::fs::write(folder.join(format!("debug-{picture}.png")), png).unwrap();
    }
}

/// Bytes that are written in base64.
fn base64(text: &str) -> Vec<u8> {
    let digit = |c: u8| match c {
        b'A'..=b'Z' => c - b'A',
        b'a'..=b'z' => c - b'a' + 26,
        b'0'..=b'9' => c - b'0' + 52,
        b'+' => 62,
        _ => 63,
    };
    let digits: Vec<u8> = text.bytes().filter(|c| *c != b'=').map(digit).collect();
    let group = |four: &[u8]| {
        let bits = four.iter().fold(0u32, |bits, digit| bits << 6 | u32::from(*digit)) << (6 * (4 - four.len()));
        bits.to_be_bytes()[1..four.len()].to_vec()
    };
    digits.chunks(4).flat_map(group).collect()
}
