// The live page: the server says what it is doing and which scene is the newest; the page fetches what it lacks.

let shownRevision = 0, fetching = false, news = null, failures = 0;

function follow() {
  const box = byId("live");
  box.hidden = false;
  box.textContent = "connecting";
  const source = new EventSource("events");
  source.onmessage = (event) => { news = JSON.parse(event.data); tellNews(box); fetchScene(); };
  source.onerror = () => {
    box.classList.add("off");
    box.textContent = "the watch has ended, or cannot be reached; these are its last results";
  };
}

function tellNews(box) {
  const { phase, done, calls, running } = news;
  box.classList.remove("off");
  const now = running.length ? `: ${running.slice(0, 3).join(", ")}${running.length > 3 ? ` and ${running.length - 3} more` : ""}` : "";
  box.textContent = phase === "running" ? `computing, ${done} of ${calls} nodes${now}` : phase === "broken" ? "the graph has errors; these are the last results" : "up to date, watching";
  trouble(news.trouble);
}

async function fetchScene() {
  if (fetching || !news || news.revision === shownRevision || news.revision === 0) return;
  fetching = true;
  try {
    const answer = await fetch("scene.json", { cache: "no-store" });
    const revision = Number(answer.headers.get("x-revision")), next = await answer.json();
    window.salient.loaded = await loadArrays(next);
    show(next);
    shownRevision = revision;
    window.salient.revision = revision;
    failures = 0;
  } catch (error) {
    // A newer scene may have replaced this one meanwhile; its number comes with the next news.
    console.warn(String(error));
    failures++;
    await new Promise((wait) => setTimeout(wait, 200));
  }
  fetching = false;
  if (news.revision !== shownRevision && failures < 5) fetchScene();
}
