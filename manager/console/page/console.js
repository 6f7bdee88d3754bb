// The page's beginning: the socket, and what comes over it to the panels.
import { Chart } from "/chart.js";
import { Picture } from "/picture.js";
import { Panels } from "/panels.js";

/** A connection that is lost is tried again after so long, ms; longer and longer. */
const RETRY = [250, 500, 1000, 2000];
/** Nothing heard for so long: the rig, or the way to it, is gone. */
const SILENCE_MS = 3000;

let token = sessionStorage.getItem("token");
let socket = null;
let attempts = 0;
let heard = performance.now();

/** Has something done; says how that went. Returns whether it was. */
async function ask(what) {
  const headers = { "content-type": "application/json" };
  if (token) headers.authorization = `Bearer ${token}`;
  try {
    const answer = await fetch("/api/v1/control", { method: "POST", headers, body: JSON.stringify(what) });
    const body = await answer.json();
    if (answer.status === 401) {
      token = null;
      sessionStorage.removeItem("token");
      panels.onToken(false);
    }
    panels.say(body.done ?? body.error, !answer.ok);
    return answer.ok;
  } catch {
    panels.say("The rig does not answer; nothing has been changed.", true);
    return false;
  }
}

const picture = new Picture(document);
const chart = new Chart(document);
const panels = new Panels(document, {
  ask,
  unlock(text) {
    token = text;
    sessionStorage.setItem("token", text);
    panels.onToken(true);
    panels.say("Controls are unlocked for this tab.");
  },
  hasToken: () => Boolean(token),
});

function onText(text) {
  const message = JSON.parse(text);
  if (message.hello) {
    panels.onHello(message.hello);
    chart.begin(message.history);
    panels.onHistory(message.history);
  }
  if (message.state) {
    chart.add(message.sample, message.state.deadline_ms);
    panels.onState(message.state, message.sample);
    picture.onState(message.state);
  }
  if (message.silence) panels.onSilence(`RIG STUCK`, message.silence);
}

function connect() {
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/api/v1/watch`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => { attempts = 0; if (document.hidden) socket.send("hide"); };
  socket.onmessage = async event => {
    heard = performance.now();
    if (typeof event.data === "string") { onText(event.data); return; }
    const from = socket;
    await picture.show(event.data);
    if (from.readyState === WebSocket.OPEN) from.send("shown");
  };
  socket.onclose = () => {
    panels.onSilence("NO CONTACT", "the rig does not answer");
    setTimeout(connect, RETRY[Math.min(attempts++, RETRY.length - 1)]);
  };
}

document.addEventListener("visibilitychange", () => {
  if (socket?.readyState === WebSocket.OPEN) socket.send(document.hidden ? "hide" : "look");
});
setInterval(() => {
  if (socket?.readyState === WebSocket.OPEN && performance.now() - heard > SILENCE_MS && !document.hidden) {
    panels.onSilence("NO CONTACT", "nothing has been heard from the rig for 3 s");
  }
}, 500);
connect();
