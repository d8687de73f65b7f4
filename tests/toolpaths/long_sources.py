"""Programs of every kind of line, made to be read in pieces, and lines that spoil them."""


def place(n):
    return f"X{220 + 2 * n}.000 Y{150 - n}.000 Z-5.000"


def milling(count=60, turn=""):
    """Three axes or, with `turn`, five: words left out, rapids, feeds, comments, a tool change, block numbers."""
    text = (
        "%\nO100 (part)\nG21 G90 G54\nT1 M6\nG0 X220. Y150. Z30. A5.0 C10.0\n"
        if turn
        else "G21 G54\nG0 X220. Y150. Z30.\n"
    )
    for n in range(count):
        words = place(n) + (f" A{5 + 0.01 * n:.4f} C{10 + 0.02 * n:.4f}" if turn else "")
        text += f"N{10 * n} G1 {words}\n"
        text += {
            7: "F800 (slower)\n",
            13: f"X{221 + 2 * n}.000 {words.split(maxsplit=1)[1]} F900\n",
            23: f"G0 Z30.\nG0 X250. Y100. Z30.{turn}\n",
            31: "M8\n(a comment with X1.0 in it)\n",
            43: "G54\n",
        }.get(n, "")
    return text + "M30\n%\n"


def cutter_location(count=60, axes=True):
    """Points with or without axes, rapids, feeds, and a record over two lines."""
    text = "PARTNO LONG\nUNITS/MM\nMULTAX\nFEDRAT/800,MMPM\n"
    for n in range(count):
        axis = f",0.0{n % 5}0000,0.000000,0.999000" if axes else ""
        text += f"GOTO/{220 + 2 * n}.0000,{150 - n}.0000,-5.0000{axis}\n"
        text += {
            9: f"RAPID\nGOTO/{220 + 2 * n}.0000,{150 - n}.0000,30.0000{axis}\nFEDRAT/900\n",
            19: f"GOTO/{221 + 2 * n}.0000,$\n{150 - n}.0000,-5.0000{axis}\n",
            33: "$$ a comment\nPPRINT/HALF\n",
        }.get(n, "")
    return text + "FINI\n"


def module(count=60, wobj=r" \WObj:=part"):
    """Literal targets, a joint move to a declared point and its like in between, speeds, signals, comments."""
    text = "MODULE Long\nCONST robtarget home:=[[900,0,900],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
    text += f"CONST speeddata cut:=[20,500,5000,1000];\nPROC main()\nConfL\\Off;\nMoveJ home,v200,fine,mill{wobj};\n"
    for n in range(count):
        pose = f"[[{220 + 2 * n}.00,{150 - n}.00,-5.00],[0.0173648,0.9848078,0.1736482,0.0{n % 5}]"
        move = f"MoveL {pose},[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],{{}},z1,mill{wobj};"
        text += move.format("v50") + "\n"
        text += {
            7: move.format("cut") + " ! slower\n",
            17: "SetDO spindle,1;\nWaitTime 1;\n",
            29: f"MoveJ home,v200,fine,mill{wobj};\n",
        }.get(n, "")
    return text + "ENDPROC\nENDMODULE\n"


def script(count=60):
    """Literal poses, a joint move to a named pose and its like in between, a speed by name, blocks, signals, comments."""
    text = "def long():\n  home = p[0.9,0,0.9,3.06,0.54,0]\n  speed = 0.05\n  movej(home, a=1, v=1)\n"
    for n in range(count):
        move = (
            f"  movel(p[{0.22 + 0.002 * n:.5f},{0.15 - 0.001 * n:.5f},-0.00500,3.06020,0.53960,0.0{n % 5}000],{{}})\n"
        )
        text += move.format(" a=1.2, v=speed, r=0.001")
        text += {
            7: '  speed = 0.03\n  set_digital_out(1, True) # movel(p[1,2,3,0,0,0])\n  popup("a ] in )")\n',
            17: "  while digital_in(3):\n    sleep(0.1)\n  end\n",
            29: "  movej(home, a=1, v=1)\n",
            3: "  plane = p[0,0,0.1,0,0,0]\n  plane = p[0,0,0.2,0,0,0]\n",
            37: move.format("1.2,0.04,0,0.002"),
            49: move.format("a=1").replace("p[", "pose_trans(plane, p[").replace("]", "])"),
            43: move.format("\n    a=1, v=0.02"),
        }.get(n, "")
    return text + "end\n"


def listing(count=60):
    """A point a motion, joint moves to a point that no other motion goes to, arcs, feeds, a frame set by number, remarks, calls."""
    moves, points = ["UFRAME_NUM=1"], []

    def point(n):
        place = f"X = {220 + 2 * n}.000 mm, Y = {150 - n}.000 mm, Z = -5.000 mm"
        turn = f"W = 170.000 deg, P = -6.000 deg, R = 0.{n % 5}00 deg"
        frames = "UF : F, UT : 2, CONFIG : 'N U T, 0, 0, 0'"
        points.append(f"P[{len(points) + 1}]{{\n   GP1:\n\t{frames},\n\t{place},\n\t{turn}\n}};")
        return f"P[{len(points)}]"

    for n in range(count):
        kind = "J" if n == 11 else f"C {point(n)}\n    :" if n == 19 else "A" if n == 41 else "L"
        option = {7: " ACC50", 23: " TB .5sec,CALL GRIP(1)"}.get(n, "")
        moves.append(f"{kind} {point(n + (n == 19))} 50mm/sec CNT10{option}")
        more = {5: "!remark L P[7] 9mm/sec", 29: "CALL SPINDLE(1)", 33: f"L P[{len(points)}] 60mm/sec FINE"}
        moves += [more[n]] if n in more else []
    moves.append("J P[12] 50% FINE")
    numbered = "".join(f"{n:4}:{move}    ;\n" for n, move in enumerate(moves, 1))
    return "/PROG  LONG\n/ATTR\nOWNER = MNEDITOR;\n/MN\n" + numbered + "/POS\n" + "\n".join(points) + "\n/END\n"


SOURCES = {
    "three.nc": (milling(), {}),
    "five.nc": (milling(turn=" A5.0 C10.0"), {"gcode": {"rotary": "AC"}}),
    "axes.cl": (cutter_location(), {}),
    "plain.cl": (cutter_location(axes=False), {}),
    "long.mod": (module(), {}),
    "long.script": (script(), {}),
    "long.ls": (listing(), {}),
}


STRAY = {
    ".nc": [
        "G0 X1. Y2. Z3.",
        "G91",
        "G90",
        "G1 X300.",
        "G2 X250. Y100. Z-5. I1. J0.",
        "G55",
        "G41",
        "M6",
        "G81 Z1 R1",
        "G92 X0",
    ]
    + ["/G1 X1.", "(comment", "F77", "M98 P1", "O7", "G94", "G93", "#1=3", "G1 X#1", f"G1 {place(3)} A1. C2."],
    ".cl": [
        "RAPID",
        "GODLTA/1,0,0",
        "CYCLE/DRILL",
        "CYCLE/OFF",
        "TLAXIS/0,0,1",
        "MULTAX/OFF",
        "UNITS/INCH",
        "GOHOME",
        "$$ c",
    ]
    + [
        "REMARK text",
        "    GOTO/1,2,3",
        "FEDRAT/5,IPM",
        "CIRCLE/1,2,3,0,0,1,5",
        "GOTO/1,2,3",
        "CUTCOM/LEFT",
        "CUTCOM/OFF",
    ],
    ".mod": [
        "ConfL\\On;",
        "SetDO a,1;",
        "foo;",
        "MoveJ home,v200,fine,mill;",
        "MoveL Offs(home,1,2,3),v50,z1,mill;",
        "x:=5;",
    ]
    + [
        "IF a THEN",
        "ENDIF",
        "VAR num x;",
        "MoveC home,home,v5,z1,mill;",
        "ENDPROC",
        "PROC other()",
        's:="a;b";',
        "mill.x:=3;",
    ],
    ".script": [
        "movej(home, a=1)",
        "movej([0,0,0,0,0,0])",
        "if a:",
        "end",
        "home = p[1,2,3,0,0,0]",
        "speed = speed * 2",
        "movel(home, v=speed)",
        "movec(p[1,2,3,0,0,0], home, r=0.1)",
        "movel(pose_trans(home, p[0,0,0.1,0,0,0]), v=speed)",
        "foo()",
        "x = foo(",
        ")",
        "force_mode(home)",
        "set_tcp(p[0,0,0.1,0,0,0])",
        "sleep(1)",
        '"',
        "thread other():",
    ],
    ".ls": [
        "   1:L P[70] 50mm/sec FINE    ;",
        "   1:J P[99] 50% FINE    ;",
        "   1:J P[12] 50% FINE    ;",
        "   1:L P[30] 50mm/sec FINE Offset,PR[1]    ;",
        "   1:L PR[30] 50mm/sec FINE    ;",
        "   1:P[30]=LPOS    ;",
        "   1:L P[31] 50mm/sec CNT5 ; L P[32] 60mm/sec FINE ;",
        "   1:CALL X    ;",
        "   1:UFRAME_NUM=2    ;",
        "   1:UFRAME[1]=PR[2]    ;",
        "   1:!L P[3]    ;",
        "   1:L P[R[2]] 50mm/sec FINE    ;",
        "   1:C P[20]",
        "P[5]{\n   GP1:\n\tUF : 0, UT : 1,\n\tJ1= 0.0 deg\n};",
        "P[90]{",
        "};",
        "/END",
        "/POS",
        "/MN",
        ";",
    ],
}
