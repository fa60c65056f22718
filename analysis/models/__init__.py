"""Models of a reducer: a measured loop in; cubic, compliance + gap + Dahl, Bouc–Wen or Maxwell-slip model out."""
