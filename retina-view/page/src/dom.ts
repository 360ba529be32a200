// Elements by function calls. Text is always text: nothing that the server sends becomes markup.

type Child = Node | string | null | undefined | false;
type Attributes = Record<string, string | number | boolean | EventListener | null | undefined>;

function filled<T extends Element>(element: T, attributes: Attributes, children: Child[]): T {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") {
      element.addEventListener(name, value);
    } else if (value === true) {
      element.setAttribute(name, "");
    } else if (value !== false && value !== null && value !== undefined) {
      element.setAttribute(name, String(value));
    }
  }
  element.append(...present(children));
  return element;
}

function present(children: Child[]): (Node | string)[] {
  return children.filter((child): child is Node | string => child !== null && child !== undefined && child !== false);
}

export function h<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  return filled(document.createElement(tag), attributes, children);
}

export function s(tag: string, attributes: Attributes = {}, ...children: Child[]): SVGElement {
  return filled(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
}

/**
 * New content for an element. What one has opened stays open, and the focus stays with the element of the same `data-key`.
 * Where that element is gone or cannot be pressed now, the focus goes to the parent, not to the start of the page.
 */
export function put(parent: HTMLElement, ...children: Child[]): void {
  const active = document.activeElement;
  const inside = active !== null && active !== parent && parent.contains(active);
  const focused = inside ? active.getAttribute("data-key") : null;
  const opened = keyed(parent, "details[open] > summary").map((summary) => summary.dataset["key"]);
  parent.replaceChildren(...present(children));
  for (const summary of keyed(parent, "details > summary")) {
    if (opened.includes(summary.dataset["key"])) {
      summary.parentElement?.setAttribute("open", "");
    }
  }
  if (!inside) {
    return;
  }
  const again = focused === null ? undefined : keyed(parent, "[data-key]").find((element) => element.dataset["key"] === focused);
  again?.focus();
  if (again === undefined || document.activeElement !== again) {
    parent.tabIndex = -1;
    parent.focus({ preventScroll: true });
  }
}

function keyed(parent: HTMLElement, selector: string): HTMLElement[] {
  return [...parent.querySelectorAll<HTMLElement>(selector)].filter((element) => element.dataset["key"] !== undefined);
}

/** Tells those who do not see the page. */
export function tell(text: string): void {
  const told = document.getElementById("told");
  if (told && told.textContent !== text) {
    told.textContent = text;
  }
}

/** A colour of the style sheet. */
export function colour(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}
