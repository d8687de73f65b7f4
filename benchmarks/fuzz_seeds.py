"""What the readers of all dialects are fed with: snippets, real programs, words, and ways to damage them."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

from hypothesis import strategies as st

from toolpaths.formats import Dialect

ROOT = Path(__file__).parents[1]
REAL = [*(ROOT / "../shared/data/programs").glob("*"), ROOT / "examples/kr270/pocket.src"]
# A piece of a real program is enough: what is looked for is in lines, not in lengths.
PIECE = 1500
LONG_BYTES = 200_000

SNIPPETS = [
    b"&ACCESS RVP\nDEF a()\n$BASE=BASE_DATA[1]\nLIN {X 1.0,Y 2.0,Z 3.0,A 0,B 0,C 0} C_DIS\nCIRC {X 2,Y 3},{X 4,Y 5,Z 6}\nLIN XP1\nEND\n",
    b"DEFDAT a PUBLIC\nDECL E6POS XP1={X 1.0,Y 2.0,Z 3.0,A 0,B 90.0,C -130.82,S 2,T 34,E1 0.0}\nENDDAT\n",
    b"MODULE m\nCONST robtarget p1:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\nPROC main()\nMoveL p1,v100,z5,tool\\WObj:=w;\n"
    b"MoveL [[1.5,2,3],[0.7071,0,0,0.7071],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v50,fine,tool;\nENDPROC\nENDMODULE\n",
    b"/PROG A\n/MN\n   1:L P[1] 50mm/sec CNT100 ;\n   2:J P[2] 5% FINE ;\n/POS\nP[1]{\n GP1:\n UF : 1, UT : 1, CONFIG : 'N U T, 0, 0, 0',\n"
    b" X = 1.0 mm, Y = 2.0 mm, Z = 3.0 mm,\n W = 0.0 deg, P = 0.0 deg, R = 0.0 deg\n};\n/END\n",
    b"def p():\n  set_tcp(p[0,0,0.1,0,0,0])\n  movel(p[0.1,0.2,0.3,0,3.14,0], a=1.2, v=0.25, r=0.001)\n  movej([0,0,0,0,0,0])\nend\n",
    b"x_mm,y_mm,z_mm,a_deg,b_deg,c_deg\n1,2,3,0,0,0\n2.5,3,4,0,0,0\n",
    b"%\nO1\nN1 G21 G90 G54\nG0 X0 Y0 Z5\nG1 Z-1 F100\nX4.369\nG2 X1 Y1 I1 J0\nG18 G3 X2 Z3 R5 (c)\n/G1 X[#1] A3 C4\nG91 G28 Z0\nM30\n%\0\0",
    b"$$*CATIA0\n$$ 1.0 0.0 0.0 0.0\n$$ 0.0 1.0 0.0 0.0\n$$ 0.0 0.0 1.0 0.0\nUNITS/MM\nMULTAX\nRAPID\nGOTO / 1.0, 2.0, 3.0, $\n 0.0, 0.0, 1.0\n"
    b"FEDRAT/MMPM,100\nGOTO/4,5,6\nCIRCLE/0,0,0,0,0,1,5\nGOTO/5,6,7\nINDIRV/0,1,0\nTLON,GOFWD/ (CIRCLE/ 25.0, 10.0, 0.0,$\n 10.0),ON,(LINE/ 1,2,3,$\n"
    b" 4,5,6)\nCYCLE/DRILL\nREMARK x\n  y GOTO/\n",
    b"DEF a()\nLIN {X 1.0,Y 2.0,Z 3.0,A 0,B 0,C 0}\nSLIN XP1 C_DIS\nLIN XP1\nEND\n",
]
VAL3 = (
    b'<?xml version="1.0" encoding="utf-8" ?>\r\n<Programs xmlns="http://www.staubli.com/robotics/VAL3/Program/2">\r\n<Program name="start">'
    b"<Code><![CDATA[\nbegin\n  movel(p[0],tMill[0],mSpeed[0]) // movel(p[9]\n  movec( p[1] ,p[2], tMill, mSpeed[1])\n  movej(jHome,tMill,mSpeed)\n"
    b"end\n]]></Code></Program></Programs>"
)
_VALUE = b'<Value key="%d" x="1.5" y="-6.159" z="500.000" rx="175.4" ry="8.4" rz="46.4" shoulder="lefty" fatherId="fPart[0]" />\n'
# Files with points that belong to a program: fed undamaged beside a damaged program, and damaged beside an undamaged one.
POINTS = {
    "krl": ("a.dat", SNIPPETS[1]),
    "val3": (
        "a.dtx",
        b'<?xml version="1.0" encoding="utf-8" ?>\n<Database xmlns="http://www.staubli.com/robotics/VAL3/Data/2"><Datas>\n'
        b'<Data name="fPart" type="frame" size="1"><Value key="0" x="1650.0" fatherId="world[0]" /></Data>\n<Data name="p" type="pointRx" size="3">\n'
        + b"".join(_VALUE % n for n in range(3))
        + b'</Data><Data name="mSpeed" type="mdesc" size="1"><Value key="0" tmax="50" /></Data>'
        b'<Data name="tMill" type="tool" size="1"><Value key="0" x="1" z="55.3" fatherId="flange[0]" /></Data></Datas></Database>',
    ),
}
WORDS = st.sampled_from(
    b"LIN|PTP|CIRC|SPL|{X 1|,Y 2|}|,A 0,B 0,C 0}|XP1|DECL E6POS |$BASE=|DEF a()|END|MoveL |MoveC |[[1,2,3],[1,0,0,0],|9E9|robtarget |:=|;|"
    b"PROC main()|P[1]|/MN|/POS|CONFIG : 'N U T'|L P[1] 5mm/sec FINE|movel(|p[0.1,0,0,0,0,0]|pose_trans(|def f():|end|GOTO/|1,2,3|,0,0,1|$|$$|'|"
    b"REMARK|RAPID|CIRCLE/|TLON,GOFWD/|G1|G0|G2|G91|G41|G81|X1|Y-2.5|Z.5|A3|I1|J-1|R5|F100|N10|M98|#1|[|]|(|)|%|/|;|<Data|<![CDATA[|]]>|"
    b'<point|x="1"|x_mm,y_mm,z_mm|1,2,3|"|1e|E-5|-0.000|99999999999999999999|.|-|+| |\t|\n|\r\n|\n|\n|\0|\xff|\xef\xbb\xbf|\xc3\xa9'.split(
        b"|"
    )
)


def mutated(seeds: list[bytes]) -> st.SearchStrategy[bytes]:
    """Programs with pieces deleted, doubled, moved and overwritten."""

    @st.composite
    def build(draw: st.DrawFn) -> bytes:
        text = draw(st.sampled_from(seeds))
        for _ in range(draw(st.integers(1, 6))):
            a, b = sorted((draw(st.integers(0, len(text))), draw(st.integers(0, len(text)))))
            b = min(b, a + draw(st.sampled_from([1, 8, 60])))
            what = draw(st.sampled_from(["cut", "double", "noise", "word", "number", "splice"]))
            middle = text[a:b]
            if what == "cut":
                middle = b""
            elif what == "double":
                middle *= draw(st.integers(2, 4))
            elif what == "noise":
                middle = draw(st.binary(max_size=6))
            elif what == "word":
                middle = b"".join(draw(st.lists(WORDS, max_size=4)))
            elif what == "number":
                middle = draw(
                    st.sampled_from([b"1e309", b"-", b".", b"0" * 70, b"nan", b"1.2.3", b"1e-400", b"9" * 400, b"0.0"])
                )
            else:
                other = draw(st.sampled_from(seeds))
                at = draw(st.integers(0, len(other)))
                middle = other[at : at + 80]
            text = text[:a] + middle + text[b:]
        return text

    return build()


def long_runs(seeds: list[bytes]) -> Iterator[bytes]:
    """One piece again and again, after a line that is a program."""
    pieces = [
        b"(",
        b")",
        b"{",
        b"[",
        b"$",
        b"$\n",
        b"$$\n",
        b'"',
        b"'",
        b"1",
        b"1,",
        b" ",
        b"\n",
        b"N1 ",
        b"X1",
        b"G1X1\n",
        b"LIN {",
        b"GOTO/",
        b"\0",
    ]
    pieces += [
        b"-",
        b"P[1]",
        b"<",
        b"<![CDATA[",
        b"MoveL ",
        b"movel(",
        b"p[",
        b"A ",
        b";",
        b"/",
        b"DECL E6POS A={",
        b"TLON,GOFWD/(CIRCLE/1,$\n",
        b"G2 R1 ",
    ]
    pieces += [
        b"$$-> CSYS / 1,$\n",
        b"REMARK x\n  y",
        b"G91\nG1 X1\n",
        b"X1 Y1 I5\n",
        b"IF ",
        b"LOOP\n",
        b"ENDLOOP\n",
        b"a:=b;",
        b":",
        b"1.0 ",
    ]
    for piece in pieces:
        yield seeds[0] + piece * (LONG_BYTES // len(piece))


def seeds_of(dialect: Dialect) -> list[bytes]:
    """Snippets and pieces of real programs: those the dialect recognises, or all."""
    if dialect.name == "parquet":
        return _tables()
    texts = [*SNIPPETS, VAL3]
    for path in REAL:
        if path.is_file() and path.suffix != ".md":
            raw = path.read_bytes()
            texts += [raw[:PIECE], raw[len(raw) // 2 : len(raw) // 2 + PIECE]]
    own = [text for text in texts if dialect.recognises(text, "")]
    return own or texts


def _tables() -> list[bytes]:
    """A Parquet table, where pyarrow is installed."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        return [b"PAR1"]
    found = io.BytesIO()
    pq.write_table(pa.table({f"{axis}_mm": [1.0, 2.5] for axis in "xyz"} | {"note": ["a", "b"]}), found)
    return [found.getvalue()]
