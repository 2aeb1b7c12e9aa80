// The page edits marks, outlines of balls or a depth mesh; the server says which.

import { ballsSubject } from "./balls.js";
import { doc, start } from "./editor.js";
import { marksSubject } from "./marks.js";
import { meshSubject } from "./mesh.js";

start({ marks: marksSubject, balls: ballsSubject, mesh: meshSubject }[doc.kind]());
