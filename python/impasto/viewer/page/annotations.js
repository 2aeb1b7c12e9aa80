// Notes on places of the painting, as Web Annotations of W3C: kept in the browser, saved and opened as JSON.

const CONTEXT = "http://www.w3.org/ns/anno.jsonld";
const FRAGMENT = "http://www.w3.org/TR/media-frags/";
const MOST = 2000, LONGEST = 10000;

const identifier = () => `urn:uuid:${crypto.randomUUID?.() ?? "00000000-0000-4000-8000-" + Math.random().toString(16).slice(2).padEnd(12, "0").slice(0, 12)}`;

export function note([x, y, width, height], text, source) {
  return {
    "@context": CONTEXT,
    id: identifier(),
    type: "Annotation",
    motivation: "commenting",
    created: new Date().toISOString(),
    body: { type: "TextualBody", value: text, format: "text/plain" },
    target: { source, selector: { type: "FragmentSelector", conformsTo: FRAGMENT, value: `xywh=pixel:${[x, y, width, height].map(Math.round).join(",")}` } },
  };
}

export function placeOf(annotation) {
  const found = /^xywh=(?:pixel:)?(\d+),(\d+),(\d+),(\d+)$/.exec(annotation?.target?.selector?.value ?? "");
  return found ? found.slice(1).map(Number) : null;
}

export const textOf = annotation => String(annotation?.body?.value ?? "").slice(0, LONGEST);

// Annotations from a page, a list or a single one; what is none of this painting is left out.
export function annotationsOf(content, doc) {
  const list = Array.isArray(content) ? content : content?.items ?? (content?.type === "AnnotationPage" ? [] : [content]);
  if (!Array.isArray(list)) return [];
  return list.slice(0, MOST).filter(one => {
    const place = placeOf(one);
    return place && place[0] < doc.width && place[1] < doc.height;
  });
}

export const annotationPage = list => ({ "@context": CONTEXT, id: identifier(), type: "AnnotationPage", items: list });
