// One trial after another: pictures in the order of the server, which alone knows their degrees.

const at = (id) => document.getElementById(id);
const state = { doc: null, position: 0, steps: 0, since: 0, pictures: [], step: "load" };

async function load() {
  const answer = await fetch("document.json");
  if (!answer.ok) throw new Error((await answer.json()).error);
  state.doc = await answer.json();
}

function say(words, wrong = false) {
  at("said").textContent = words;
  at("said").classList.toggle("wrong", wrong);
}

function show(step) {
  state.step = step;
  document.documentElement.dataset.step = step;
  at("picture").hidden = at("keys").hidden = step !== "match";
  at("words").hidden = step === "match";
  at("clock").textContent = "";
}

function message(title, text, button) {
  at("title").textContent = title;
  at("text").textContent = text;
  at("go").hidden = !button;
  at("go").textContent = button ?? "";
  if (button) at("go").focus();
}

function adapt() {
  show("adapt");
  const end = performance.now() + 1000 * state.doc.adapt_seconds;
  message("Look at the painting", "Take in its colours under the lamp. You will compare them with pictures from memory.");
  const tick = () => {
    const left = Math.ceil((end - performance.now()) / 1000);
    if (left <= 0) return ready();
    const seconds = String(left % 60).padStart(2, "0");
    at("clock").textContent = `${Math.floor(left / 60)}:${seconds}`;
    setTimeout(tick, 200);
  };
  tick();
}

function ready() {
  show("ready");
  message(
    "Which picture looks most like the painting?",
    "Step through the pictures with the arrow keys, as often as you like, and press Enter on the one that is closest.",
    "Begin",
  );
}

// All pictures of a trial are loaded first: none may come later than another.
async function trial() {
  show("load");
  message("Loading", "", null);
  const { trial, trials, pictures } = state.doc;
  if (trial >= trials) {
    show("done");
    at("where").textContent = "";
    return message("Thank you", "All matches are made. This page can be closed.", null);
  }
  state.pictures = await Promise.all(
    Array.from({ length: pictures }, async (_, position) => {
      const one = new Image();
      one.src = `picture/${position}?trial=${trial}`;
      await one.decode();
      return one;
    }),
  );
  Object.assign(state, { position: 0, steps: 1, since: performance.now() });
  show("match");
  draw();
}

function draw() {
  at("picture").src = state.pictures[state.position].src;
  at("picture").dataset.position = state.position;
  at("where").textContent =
    `match ${state.doc.trial + 1} of ${state.doc.trials} · picture ${state.position + 1} of ${state.doc.pictures}`;
}

function step(by) {
  const count = state.doc.pictures;
  state.position = (state.position + by + count) % count;
  state.steps += 1;
  draw();
}

async function choose() {
  show("saving");
  message("Saving", "", null);
  const content = {
    trial: state.doc.trial, position: state.position, steps: state.steps,
    seconds: (performance.now() - state.since) / 1000,
  };
  try {
    const answer = await fetch("save", {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(content),
    });
    const found = await answer.json();
    if (!answer.ok) throw new Error(found.error);
    say("");
    await load();
    await trial();
  } catch (error) {
    // The choice is not lost: the same picture is shown again.
    say(`not saved: ${error.message}`, true);
    show("match");
    draw();
  }
}

addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
  if (state.step === "match") {
    const moves = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };
    if (event.key in moves) step(moves[event.key]);
    else if (event.key === "Enter") choose();
    else return;
    event.preventDefault();
  }
});
at("go").addEventListener("click", () => trial().catch((error) => say(error.message, true)));

try {
  await load();
  if (state.doc.trial >= state.doc.trials) await trial();
  else adapt();
} catch (error) {
  message("The session cannot be shown", error.message, null);
}
document.documentElement.dataset.ready = "yes";
