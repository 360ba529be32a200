// One page: the start, a session of the workbench, or another pane. The address's fragment says which, so that a window can
// be opened twice.

import "./view.css";
import { get, type StartDocument } from "./api";
import { BenchPane } from "./benchpane";
import { LivePane } from "./live";
import { OpticsPane } from "./opticspane";
import { ResultsPane } from "./results";
import { Sequence } from "./sequence";
import { showStart } from "./start";
import { Workbench } from "./workbench";

const page = document.getElementById("page") as HTMLElement;
let leave: () => void = () => undefined;

/** What a pane is opened with: a place in the given paths, or a name that ships. */
const PANES: Record<string, new (page: Element, at: string) => { close(): void }> = { sequence: Sequence, results: ResultsPane, scene: LivePane, bench: BenchPane, optics: OpticsPane };

function show(): void {
  leave();
  const [, kind, at] = /^#([a-z]+)=(.+)$/.exec(window.location.hash) ?? [];
  const pane = kind === undefined ? undefined : PANES[kind];
  document.title = "RETINA";
  if (pane && at !== undefined) {
    let named = at;
    try {
      named = decodeURIComponent(at);
    } catch {
      // An address by hand: the server says that there is no such file.
    }
    const shown = new pane(page, named);
    leave = () => shown.close();
  } else if (kind === "session" && at !== undefined && /^[a-z0-9-]+$/.test(at)) {
    const workbench = new Workbench(page, at, open);
    leave = () => workbench.close();
  } else {
    leave = showStart(page, open);
  }
}

function open(id: string): void {
  if (window.location.hash === `#session=${id}`) {
    show();
  } else {
    window.location.hash = `session=${id}`;
  }
}

const theme = window.localStorage.getItem("theme");
if (theme === "light" || theme === "dark") {
  document.documentElement.dataset["theme"] = theme;
}
window.addEventListener("hashchange", show);
if (window.location.hash === "") {
  // What the command line names is opened at once.
  get<StartDocument>("/api/start").then((start) => {
    if (start.first === null) show();
    else window.location.hash = start.first;
  }, show);
} else {
  show();
}
