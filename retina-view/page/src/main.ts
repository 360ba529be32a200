// One page: the start, or a session. The address's fragment says which, so that a window can be opened twice.

import "./view.css";
import { get, type StartDocument } from "./api";
import { Workbench } from "./workbench";
import { showStart } from "./start";

const page = document.getElementById("page") as HTMLElement;
let leave: () => void = () => undefined;

function show(): void {
  leave();
  const id = /^#session=([a-z0-9-]+)$/.exec(window.location.hash)?.[1];
  document.title = "RETINA workbench";
  if (id === undefined) {
    leave = showStart(page, open);
  } else {
    const workbench = new Workbench(page, id, open);
    leave = () => workbench.close();
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
  // The session of the command line is opened at once.
  get<StartDocument>("/api/start").then((start) => (start.first === null ? show() : open(start.first)), show);
} else {
  show();
}
